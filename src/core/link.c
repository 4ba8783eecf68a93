#include "gsid/link.h"

#include <string.h>

/* Two sync bytes, kind, flags, tick, a, b, check: the same length for every kind, so that the receiver never
 * depends on an unchecked length. */
#define SYNC_0 0xA5u
#define SYNC_1 0x5Au
#define AT_KIND 2u
#define AT_FLAGS 3u
#define AT_TICK 4u
#define AT_A 8u
#define AT_B 12u
#define AT_CHECK 16u
#define FRAME_BYTES 18u

typedef char frame_fits_the_line[FRAME_BYTES <= GSID_LINK_FRAME_MAX ? 1 : -1];
typedef char float_is_four_bytes[sizeof(float) == 4 ? 1 : -1];

/* CRC-16/CCITT: x^16 + x^12 + x^5 + 1, high bit first, no final inversion. Every error of up to three bits, and every burst
 * of up to 16 bits, is found in a frame of this length. Frames that start from different values never have the same check:
 * a frame of another session is always found. */
static uint16_t check_of(uint32_t start, const uint8_t *bytes, size_t n_bytes) {
    static const uint16_t step[16] = {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
                                      0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF};
    uint32_t crc = start;
    for (size_t i = 0; i < n_bytes; i++) {
        crc = ((crc << 4) & 0xFFFFu) ^ step[(crc >> 12) ^ (uint32_t)(bytes[i] >> 4)];
        crc = ((crc << 4) & 0xFFFFu) ^ step[(crc >> 12) ^ (uint32_t)(bytes[i] & 0x0Fu)];
    }
    return (uint16_t)crc;
}

static void put_u32(uint8_t *bytes, uint32_t value) {
    for (uint32_t i = 0; i < 4; i++) {
        bytes[i] = (uint8_t)(value >> (8u * i));
    }
}

static uint32_t get_u32(const uint8_t *bytes) {
    uint32_t value = 0;
    for (uint32_t i = 0; i < 4; i++) {
        value |= (uint32_t)bytes[i] << (8u * i);
    }
    return value;
}

static void put_float(uint8_t *bytes, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_u32(bytes, bits);
}

static float get_float(const uint8_t *bytes) {
    uint32_t bits = get_u32(bytes);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static int is_known(uint8_t kind) {
    return kind >= GSID_FRAME_COMMAND && kind <= GSID_FRAME_RESULT;
}

/* HELLO opens a session: its receiver does not know the id yet. */
static uint32_t start_of(uint8_t kind, uint16_t session) {
    return kind == GSID_FRAME_HELLO ? 0xFFFFu : session;
}

size_t gsid_link_encode(const gsid_frame *frame, uint16_t session, uint8_t *bytes) {
    if (!frame || !bytes || !is_known(frame->kind)) {
        return 0;
    }
    bytes[0] = SYNC_0;
    bytes[1] = SYNC_1;
    bytes[AT_KIND] = frame->kind;
    bytes[AT_FLAGS] = frame->flags;
    put_u32(bytes + AT_TICK, frame->tick);
    put_float(bytes + AT_A, frame->a);
    put_float(bytes + AT_B, frame->b);
    uint16_t check = check_of(start_of(frame->kind, session), bytes + AT_KIND, AT_CHECK - AT_KIND);
    bytes[AT_CHECK] = (uint8_t)(check & 0xFFu);
    bytes[AT_CHECK + 1] = (uint8_t)(check >> 8);
    return FRAME_BYTES;
}

void gsid_link_reset(gsid_link *link) {
    if (link) {
        memset(link, 0, sizeof *link);
    }
}

/* Drop the first n_drop bytes held, and then all that cannot start a frame. */
static void drop(gsid_link *link, uint32_t n_drop) {
    uint32_t start = n_drop;
    while (start < link->n_held &&
           (link->held[start] != SYNC_0 || (start + 1 < link->n_held && link->held[start + 1] != SYNC_1))) {
        start++;
    }
    link->n_garbage += start;
    link->n_held -= start;
    memmove(link->held, link->held + start, link->n_held);
}

/* Read the frame held, when it is whole and good. A damaged one loses only its first byte: a good frame may begin among
 * the rest. */
static int take(gsid_link *link, gsid_frame *frame) {
    const uint8_t *held = link->held;
    if (link->n_held < FRAME_BYTES) {
        return 0;
    }
    uint32_t check = (uint32_t)held[AT_CHECK] | (uint32_t)held[AT_CHECK + 1] << 8;
    const uint32_t start = start_of(held[AT_KIND], link->session);
    if (check != check_of(start, held + AT_KIND, AT_CHECK - AT_KIND) || !is_known(held[AT_KIND])) {
        link->n_damaged++;
        drop(link, 1);
        return 0;
    }
    frame->kind = held[AT_KIND];
    frame->flags = held[AT_FLAGS];
    frame->tick = get_u32(held + AT_TICK);
    frame->a = get_float(held + AT_A);
    frame->b = get_float(held + AT_B);
    link->n_held = 0;
    link->n_frames++;
    return 1;
}

size_t gsid_link_decode(gsid_link *link, size_t n_bytes, const uint8_t *bytes, size_t capacity, gsid_frame *frames,
                        size_t *n_frames) {
    if (!link || !bytes || !frames || !n_frames || link->n_held >= FRAME_BYTES) {
        return 0;
    }
    size_t used = 0, found = 0;
    int opened = 0;
    while (used < n_bytes && found < capacity && !opened) {
        link->held[link->n_held++] = bytes[used++];
        if (link->n_held <= 2) {
            drop(link, 0);
        }
        if (take(link, &frames[found])) {
            opened = frames[found].kind == GSID_FRAME_HELLO;
            found++;
        }
    }
    *n_frames = found;
    return used;
}
