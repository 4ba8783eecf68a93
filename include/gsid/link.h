/* Frames on the serial line between host and axis; docs/reference/protocol.md describes the bytes. */
#ifndef GSID_LINK_H
#define GSID_LINK_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* At 921600 baud 8N1 the line carries 30.72 bytes per tick of 3 kHz each way; a frame is at most 30. */
#define GSID_LINK_FRAME_MAX 30

/* Of the protocol, in the flags of HELLO. Version 1 had none: 0. */
#define GSID_LINK_VERSION 2u

/* Ids of sessions are 1 to this. 0: no session has been opened. */
#define GSID_LINK_SESSION_MAX 65534u

typedef enum {
    GSID_FRAME_COMMAND = 1, /* host to axis: a = command for this tick, b = command for the next one */
    GSID_FRAME_SAMPLE = 2,  /* axis to host: a = command in force at this tick, b = output at this tick */
    GSID_FRAME_HELLO = 3, /* host to axis: start again at tick 0, at rest; flags = version, tick = id of the session.
                               The axis answers with both, a = ticks per second [Hz], b = commands it can queue */
    GSID_FRAME_STOP = 4, /* host to axis: command zero, forget what is queued; answered with the same */
    GSID_FRAME_RESULT = 5 /* from a drive that measures on its own: flags = meaning of a and b, tick = index */
} gsid_frame_kind;

/* Flags of a sample frame. The count reveals a lost command even if the sample of its tick was lost too. */
#define GSID_FLAG_COMMAND_LOST 1u /* no command for this tick arrived: the last one was held */
#define GSID_FLAG_LOST_COUNT 0xFEu /* twice the number of commands lost since the start, modulo 256 */

/* Always in single precision, like the line. */
typedef struct {
    uint8_t kind; /* gsid_frame_kind */
    uint8_t flags;
    uint32_t tick; /* tick to which the frame refers; HELLO: id of the session */
    float a, b;
} gsid_frame;

/* Receiver: resynchronises after garbage, counts the bytes it discards. HELLO is accepted always, other frames of this
 * session only: one of another session counts as damaged. */
typedef struct {
    uint32_t n_frames; /* good frames */
    uint32_t n_damaged; /* sync found, check failed */
    uint32_t n_garbage; /* bytes discarded outside frames */
    uint32_t n_held; /* private: bytes in held */
    uint8_t held[GSID_LINK_FRAME_MAX]; /* private */
    uint16_t session; /* set by the caller: the host before it sends HELLO, the axis when HELLO has come */
} gsid_link;

/** Write a frame as bytes.
 *  @param[in]  frame
 *  @param[in]  session  id of the session, from which the check starts; HELLO's check does not depend on it
 *  @param[out] bytes  [GSID_LINK_FRAME_MAX]
 *  @return number of bytes written; 0 for a NULL pointer or an unknown kind
 *  Cost: one table step per half byte for the check.  Context: ISR-safe. */
size_t gsid_link_encode(const gsid_frame *frame, uint16_t session, uint8_t *bytes);

/** Empty a receiver, zero its counts and clear its session. Call it before the first byte, unless the receiver is static.
 *  NULL: no effect. */
void gsid_link_reset(gsid_link *link);

/** Take bytes off the line and give whole, checked frames. It ends when `frames` is full, and after a HELLO, so that an
 *  axis can set the session of the frames behind it: call again with the bytes not consumed.
 *  @param[in]  n_bytes, bytes  [n_bytes]
 *  @param[in]  capacity        entries in frames
 *  @param[out] frames          [capacity]
 *  @param[out] n_frames        frames written
 *  @return bytes consumed; 0, with n_frames untouched, for a NULL pointer and for a receiver that was not emptied first
 *  Cost: per byte at most one check of a frame.  Context: ISR-safe, one writer. */
size_t gsid_link_decode(gsid_link *link, size_t n_bytes, const uint8_t *bytes, size_t capacity, gsid_frame *frames,
                        size_t *n_frames);

#ifdef __cplusplus
}
#endif

#endif
