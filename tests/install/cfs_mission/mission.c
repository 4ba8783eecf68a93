/* A software bus with one application on it, and a drive that sends blocks of command and rate of an axis of first order. One
 * block is lost, one message has another size, and one sample is not finite. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "gsid_app_msg.h"

#define POLE 0.98
#define GAIN 0.05
#define NOISE 1e-3
#define TURN 6.28318530717958647692
enum { BLOCKS = 200, LOST = 45, SHORT = 60, BAD = 75, MOST_EVENTS = 16 };

static GSID_APP_Samples_t samples;
static GSID_APP_Response_t response;
static int n_responses, n_received;
static uint32 n_sent;
static double rate;
static char events[MOST_EVENTS][80];
static int n_events;

static double excitation(uint32 n) {
    double u = 0;
    for (int k = 1; k <= GSID_APP_LINES; k++) {
        u += cos(TURN * k * (n % GSID_APP_PERIOD) / GSID_APP_PERIOD + k * k * TURN / (2 * GSID_APP_LINES));
    }
    return u;
}

static void fill_block(void) {
    for (uint32 i = 0; i < GSID_APP_BLOCK; i++) {
        const double u = excitation(n_sent * GSID_APP_BLOCK + i);
        samples.Command[i] = (float)u;
        samples.Rate[i] = (float)(rate + NOISE * ((double)rand() / RAND_MAX - 0.5));
        rate = POLE * rate + GAIN * u;
    }
    samples.Count = n_sent++;
}

bool CFE_ES_RunLoop(uint32 *status) {
    return *status == CFE_ES_RunStatus_APP_RUN && n_sent < BLOCKS;
}

CFE_Status_t CFE_SB_ReceiveBuffer(CFE_SB_Buffer_t **buffer, CFE_SB_PipeId_t pipe, int32 timeout) {
    fill_block();
    if (samples.Count == LOST) {
        fill_block();
    }
    const size_t cut = samples.Count == SHORT ? 4 : 0;
    CFE_MSG_Init(CFE_MSG_PTR(samples.Header), CFE_SB_ValueToMsgId(GSID_APP_SAMPLES_MID), sizeof samples - cut);
    if (samples.Count == BAD) {
        samples.Rate[7] = NAN;
    }
    n_received++;
    *buffer = (CFE_SB_Buffer_t *)&samples;
    return pipe == 7 && timeout == CFE_SB_PEND_FOREVER ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_SB_TransmitMsg(const CFE_MSG_Message_t *message, bool origination) {
    response = *(const GSID_APP_Response_t *)message;
    n_responses++;
    return origination && message->Size == sizeof response ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_EVS_SendEvent(uint16 id, CFE_EVS_EventType_Enum_t type, const char *spec, ...) {
    va_list values;
    va_start(values, spec);
    if (n_events < MOST_EVENTS) {
        vsnprintf(events[n_events++], sizeof events[0], spec, values);
    }
    va_end(values);
    return id > 0 && type > 0 ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_EVS_Register(const void *filters, uint16 n, uint16 scheme) {
    return filters == NULL && n == 0 && scheme == CFE_EVS_EventFilter_BINARY ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_SB_CreatePipe(CFE_SB_PipeId_t *pipe, uint16 depth, const char *name) {
    *pipe = 7;
    return depth > 0 && name != NULL ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_SB_Subscribe(CFE_SB_MsgId_t id, CFE_SB_PipeId_t pipe) {
    return id.Value == GSID_APP_SAMPLES_MID && pipe == 7 ? CFE_SUCCESS : -1;
}

void CFE_SB_TimeStampMsg(CFE_MSG_Message_t *message) {
    ((CFE_MSG_TelemetryHeader_t *)message)->Time[0] = n_sent;
}

CFE_SB_MsgId_t CFE_SB_ValueToMsgId(uint32 value) {
    return (CFE_SB_MsgId_t){value};
}

uint32 CFE_SB_MsgIdToValue(CFE_SB_MsgId_t id) {
    return id.Value;
}

CFE_Status_t CFE_MSG_Init(CFE_MSG_Message_t *message, CFE_SB_MsgId_t id, size_t size) {
    *message = (CFE_MSG_Message_t){id.Value, (uint32)size};
    return CFE_SUCCESS;
}

CFE_Status_t CFE_MSG_GetMsgId(const CFE_MSG_Message_t *message, CFE_SB_MsgId_t *id) {
    id->Value = message->Id;
    return CFE_SUCCESS;
}

CFE_Status_t CFE_MSG_GetSize(const CFE_MSG_Message_t *message, size_t *size) {
    *size = message->Size;
    return CFE_SUCCESS;
}

static uint32 exit_status;

void CFE_ES_ExitApp(uint32 status) {
    exit_status = status;
}

void GSID_APP_Main(void);

int main(void) {
    srand(1);
    GSID_APP_Main();
    double worst = 0;
    for (int i = 0; i < GSID_APP_LINES; i++) { /* the axis: gain / (z - pole) */
        const double w = TURN * (i + 1) / GSID_APP_PERIOD, re = cos(w) - POLE, im = sin(w), size = re * re + im * im;
        const double off = hypot(response.Real[i] - GAIN * re / size, response.Imaginary[i] + GAIN * im / size);
        worst = fmax(worst, off / response.Sigma[i]);
    }
    for (int i = 0; i < n_events; i++) {
        puts(events[i]);
    }
    printf("status %u, %d messages, %d responses, %u periods, %u spoiled, worst error %.2f sigma\n", exit_status,
           n_received, n_responses, response.Periods, response.Spoiled, worst);
    return 0;
}
