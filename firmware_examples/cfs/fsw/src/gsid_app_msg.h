/* Messages of the application: blocks of samples in, the frequency response out. */
#ifndef GSID_APP_MSG_H
#define GSID_APP_MSG_H

#include "cfe.h"

/* Values of the mission's table of message identifiers. */
#define GSID_APP_SAMPLES_MID 0x18F0
#define GSID_APP_RESPONSE_MID 0x08F0

enum {
    GSID_APP_BLOCK = 60,
    GSID_APP_PERIOD = 600,
    GSID_APP_LINES = 50
}; /* 3 kHz in blocks of 20 ms: lines 5 to 250 Hz */

/* From the drive's application, in step with the excitation that it adds: a block for each 20 ms, counted from the first. */
typedef struct {
    CFE_MSG_TelemetryHeader_t Header;
    uint32 Count;
    float Command[GSID_APP_BLOCK];
    float Rate[GSID_APP_BLOCK];
} GSID_APP_Samples_t;

typedef struct {
    CFE_MSG_TelemetryHeader_t Header;
    uint32 Periods; /* good periods in the mean */
    uint32 Spoiled; /* periods with lost samples, left out */
    float Real[GSID_APP_LINES];
    float Imaginary[GSID_APP_LINES];
    float Sigma[GSID_APP_LINES]; /* standard deviation of the response */
} GSID_APP_Response_t;

#endif
