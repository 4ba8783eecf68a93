/* Frames on the serial line: the bytes against a slow check of our own, and that no good frame is ever lost. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/link.h"

#define BYTES 18 /* docs/reference/protocol.md */
/* With some ids a piece of the garbage below has the right check by chance, as 1 in 65536 does: not with this one. */
#define SESSION 0x7777u

/* xorshift, fixed seeds: the same run every time */
static uint32_t next_random(uint32_t *state) {
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state;
}

static gsid_frame frame_of(uint8_t kind, uint32_t tick, float a, float b) {
    gsid_frame frame;
    memset(&frame, 0, sizeof frame);
    frame.kind = kind;
    frame.tick = tick;
    frame.a = a;
    frame.b = b;
    return frame;
}

/* Two frames are the same when their bits are: NaN travels too. */
static void assert_same(const gsid_frame *got, const gsid_frame *sent) {
    assert_int_equal(got->kind, sent->kind);
    assert_int_equal(got->flags, sent->flags);
    assert_int_equal(got->tick, sent->tick);
    assert_memory_equal(&got->a, &sent->a, sizeof sent->a);
    assert_memory_equal(&got->b, &sent->b, sizeof sent->b);
}

/* x^16 + x^12 + x^5 + 1, one bit at a time */
static uint16_t slow_check(uint32_t crc, const uint8_t *bytes, size_t n_bytes) {
    for (size_t i = 0; i < n_bytes; i++) {
        for (int bit = 7; bit >= 0; bit--) {
            uint32_t high = (crc >> 15 & 1u) ^ (uint32_t)(bytes[i] >> bit & 1);
            crc = (crc << 1 & 0xFFFFu) ^ (high ? 0x1021u : 0u);
        }
    }
    return (uint16_t)crc;
}

static void the_bytes_are_those_of_the_protocol(void **state) {
    (void)state;
    /* 1.0f is 3F800000, -2.5f is C0200000; "123456789" gives 29B1 with this polynomial and start */
    const uint8_t head[16] = {0xA5, 0x5A, 0x02, 0x01, 0x44, 0x33, 0x22, 0x11, 0, 0, 0x80, 0x3F, 0, 0, 0x20, 0xC0};
    gsid_frame frame = frame_of(GSID_FRAME_SAMPLE, 0x11223344u, 1.0f, -2.5f);
    frame.flags = GSID_FLAG_COMMAND_LOST;
    uint8_t bytes[GSID_LINK_FRAME_MAX];
    assert_int_equal(slow_check(0xFFFF, (const uint8_t *)"123456789", 9), 0x29B1);
    assert_int_equal(gsid_link_encode(&frame, SESSION, bytes), BYTES);
    assert_memory_equal(bytes, head, sizeof head);
    assert_int_equal(bytes[16] | bytes[17] << 8, slow_check(SESSION, bytes + 2, 14));
}

static void every_kind_and_value_comes_back(void **state) {
    (void)state;
    const uint32_t bits[] = {0, 0x80000000u, 1, 0x7F7FFFFFu, 0x7F800000u, 0x7FC00001u, 0x3F800000u, 0xA55AA55Au};
    gsid_link link;
    gsid_link_reset(&link);
    link.session = SESSION;
    for (uint8_t kind = GSID_FRAME_COMMAND; kind <= GSID_FRAME_RESULT; kind++) {
        for (size_t i = 0; i < 64; i++) {
            gsid_frame sent = frame_of(kind, bits[i % 8], 0, 0), got;
            memcpy(&sent.a, &bits[i / 8], sizeof sent.a);
            memcpy(&sent.b, &bits[i % 8], sizeof sent.b);
            sent.flags = (uint8_t)(i * 37);
            uint8_t bytes[GSID_LINK_FRAME_MAX];
            size_t n_frames;
            assert_int_equal(gsid_link_encode(&sent, SESSION, bytes), BYTES);
            assert_int_equal(gsid_link_decode(&link, BYTES, bytes, 1, &got, &n_frames), BYTES);
            assert_int_equal(n_frames, 1);
            assert_same(&got, &sent);
        }
    }
    assert_int_equal(link.n_frames, 5 * 64);
    assert_int_equal(link.n_damaged + link.n_garbage, 0);
}

/* The damaged frame must not be believed, and the good one right behind it must not be lost. */
static void assert_only_second(const uint8_t *bytes, const gsid_frame *second) {
    gsid_link link;
    gsid_frame got[4];
    size_t n_frames;
    gsid_link_reset(&link);
    link.session = SESSION;
    assert_int_equal(gsid_link_decode(&link, 2 * BYTES, bytes, 4, got, &n_frames), 2 * BYTES);
    assert_int_equal(n_frames, 1);
    assert_same(&got[0], second);
    assert_int_equal(link.n_frames, 1);
    assert_int_equal(link.n_garbage, BYTES);
}

static void every_error_of_one_and_two_bits_is_found(void **state) {
    (void)state;
    const gsid_frame first = frame_of(GSID_FRAME_COMMAND, 41, 12.5f, -3.0f);
    const gsid_frame second = frame_of(GSID_FRAME_COMMAND, 42, -3.0f, 0.25f);
    uint8_t bytes[2 * BYTES + GSID_LINK_FRAME_MAX];
    gsid_link_encode(&first, SESSION, bytes);
    gsid_link_encode(&second, SESSION, bytes + BYTES);
    for (int i = 0; i < 8 * BYTES; i++) {
        bytes[i / 8] ^= (uint8_t)(1 << i % 8);
        assert_only_second(bytes, &second);
        for (int j = 0; j < i; j++) {
            bytes[j / 8] ^= (uint8_t)(1 << j % 8);
            assert_only_second(bytes, &second);
            bytes[j / 8] ^= (uint8_t)(1 << j % 8);
        }
        bytes[i / 8] ^= (uint8_t)(1 << i % 8);
    }
}

static void a_lost_or_added_byte_costs_one_frame(void **state) {
    (void)state;
    const gsid_frame first = frame_of(GSID_FRAME_SAMPLE, 7, 1.0f, 2.0f), second = frame_of(GSID_FRAME_SAMPLE, 8, 3, 4);
    uint8_t whole[2 * GSID_LINK_FRAME_MAX], bytes[2 * GSID_LINK_FRAME_MAX];
    gsid_link_encode(&first, SESSION, whole);
    gsid_link_encode(&second, SESSION, whole + BYTES);
    for (size_t at = 0; at < BYTES; at++) {
        for (int added = 0; added < 2; added++) {
            size_t n = added ? 2 * BYTES + 1 : 2 * BYTES - 1;
            memcpy(bytes, whole, at);
            bytes[at] = 0xA5;
            memcpy(bytes + at + (added ? 1 : 0), whole + at + (added ? 0 : 1), 2 * BYTES - at - (added ? 0 : 1));
            gsid_link link;
            gsid_frame got[4];
            size_t n_frames;
            gsid_link_reset(&link);
            link.session = SESSION;
            assert_int_equal(gsid_link_decode(&link, n, bytes, 4, got, &n_frames), n);
            /* a byte before the frame, or a byte like the one it stands beside, does no harm */
            assert_in_range(n_frames, 1, added && at <= 1 ? 2 : 1);
            assert_same(&got[n_frames - 1], &second);
        }
    }
}

/* A frame full of sync bytes, cut off anywhere, must not hide the frame that follows. */
static void sync_bytes_inside_a_frame_do_no_harm(void **state) {
    (void)state;
    float sync;
    const uint32_t bits = 0x5AA55AA5u;
    memcpy(&sync, &bits, sizeof sync);
    gsid_frame first = frame_of(GSID_FRAME_COMMAND, bits, sync, sync);
    const gsid_frame second = first;
    first.flags = 0xA5;
    for (size_t kept = 0; kept <= BYTES; kept++) {
        uint8_t bytes[2 * GSID_LINK_FRAME_MAX];
        gsid_frame got[4];
        size_t n_frames;
        gsid_link link;
        gsid_link_reset(&link);
        link.session = SESSION;
        gsid_link_encode(&first, SESSION, bytes);
        gsid_link_encode(&second, SESSION, bytes + kept);
        gsid_link_decode(&link, kept + BYTES, bytes, 4, got, &n_frames);
        assert_int_equal(n_frames, kept == BYTES ? 2 : 1);
        assert_same(&got[n_frames - 1], &second);
    }
}

static void frames_may_come_in_pieces(void **state) {
    (void)state;
    const gsid_frame sent[3] = {frame_of(GSID_FRAME_RESULT, 0, 3000, 512), frame_of(GSID_FRAME_COMMAND, 1, 2, 3),
                                frame_of(GSID_FRAME_STOP, 2, 0, 0)};
    uint8_t bytes[3 * BYTES + GSID_LINK_FRAME_MAX];
    for (size_t i = 0; i < 3; i++) {
        gsid_link_encode(&sent[i], SESSION, bytes + i * BYTES);
    }
    for (size_t cut = 0; cut <= 3 * BYTES; cut++) {
        gsid_link link;
        gsid_frame got[3];
        size_t first, second;
        gsid_link_reset(&link);
        link.session = SESSION;
        assert_int_equal(gsid_link_decode(&link, cut, bytes, 3, got, &first), cut);
        assert_int_equal(first, cut / BYTES);
        assert_int_equal(gsid_link_decode(&link, 3 * BYTES - cut, bytes + cut, 3 - first + 1, got + first, &second),
                         3 * BYTES - cut);
        assert_int_equal(first + second, 3);
        for (size_t i = 0; i < 3; i++) {
            assert_same(&got[i], &sent[i]);
        }
        assert_int_equal(link.n_damaged + link.n_garbage + link.n_held, 0);
    }
}

static void a_full_list_leaves_the_rest_of_the_bytes(void **state) {
    (void)state;
    uint8_t bytes[5 * BYTES + GSID_LINK_FRAME_MAX];
    for (uint32_t i = 0; i < 5; i++) {
        const gsid_frame sent = frame_of(GSID_FRAME_COMMAND, i, 0, 0);
        gsid_link_encode(&sent, SESSION, bytes + i * BYTES);
    }
    gsid_link link;
    gsid_link_reset(&link);
    link.session = SESSION;
    size_t at = 0;
    for (uint32_t i = 0; i < 5; i++) {
        gsid_frame got;
        size_t n_frames;
        at += gsid_link_decode(&link, 5 * BYTES - at, bytes + at, 1, &got, &n_frames);
        assert_int_equal(n_frames, 1);
        assert_int_equal(got.tick, i);
        assert_int_equal(at, (i + 1) * BYTES);
    }
}

#define STREAM 200000
static uint8_t stream[STREAM + GSID_LINK_FRAME_MAX];
static gsid_frame expected[STREAM / BYTES], received[STREAM / BYTES + 1];

/* Good frames with garbage between them, rich in sync bytes and in beginnings of frames. */
static size_t fill_stream(uint32_t *seed, size_t *n_bytes) {
    size_t n = 0, at = 0;
    while (at + BYTES <= STREAM) {
        uint32_t n_garbage = next_random(seed) % 4 ? 0 : next_random(seed) % 60;
        for (; n_garbage > 0 && at + 2 * BYTES <= STREAM; n_garbage--) {
            const uint8_t choice[4] = {0xA5, 0x5A, GSID_FRAME_SAMPLE, (uint8_t)next_random(seed)};
            stream[at++] = choice[next_random(seed) % 4];
        }
        gsid_frame frame = frame_of((uint8_t)(1 + next_random(seed) % 4), next_random(seed), 0, 0);
        const uint32_t a = next_random(seed), b = next_random(seed) % 2 ? 0x5AA55AA5u : next_random(seed);
        memcpy(&frame.a, &a, sizeof a);
        memcpy(&frame.b, &b, sizeof b);
        expected[n++] = frame;
        at += gsid_link_encode(&frame, SESSION, stream + at);
    }
    *n_bytes = at;
    return n;
}

static void no_good_frame_is_lost_in_garbage(void **state) {
    (void)state;
    for (uint32_t run = 1; run <= 20; run++) {
        uint32_t seed = run * 2654435761u;
        size_t n_bytes, n_sent = fill_stream(&seed, &n_bytes), n_got = 0, at = 0;
        gsid_link link;
        gsid_link_reset(&link);
        link.session = SESSION;
        while (at < n_bytes) {
            size_t chunk = next_random(&seed) % 100, n_frames;
            if (chunk > n_bytes - at) {
                chunk = n_bytes - at;
            }
            at += gsid_link_decode(&link, chunk, stream + at, next_random(&seed) % 8, received + n_got, &n_frames);
            n_got += n_frames;
        }
        assert_int_equal(n_got, n_sent);
        for (size_t i = 0; i < n_sent; i++) {
            assert_same(&received[i], &expected[i]);
        }
        assert_int_equal(link.n_garbage + link.n_frames * BYTES + link.n_held, n_bytes);
    }
}

static void misuse_is_refused(void **state) {
    (void)state;
    gsid_frame frame = frame_of(0, 0, 0, 0);
    uint8_t bytes[GSID_LINK_FRAME_MAX] = {0};
    size_t n_frames = 77;
    gsid_link link;
    assert_int_equal(gsid_link_encode(&frame, SESSION, bytes), 0);
    frame.kind = GSID_FRAME_RESULT + 1;
    assert_int_equal(gsid_link_encode(&frame, SESSION, bytes), 0);
    frame.kind = GSID_FRAME_STOP;
    assert_int_equal(gsid_link_encode(NULL, SESSION, bytes), 0);
    assert_int_equal(gsid_link_encode(&frame, SESSION, NULL), 0);
    gsid_link_reset(NULL);
    gsid_link_reset(&link);
    link.session = SESSION;
    assert_int_equal(gsid_link_decode(NULL, 1, bytes, 1, &frame, &n_frames), 0);
    assert_int_equal(gsid_link_decode(&link, 1, NULL, 1, &frame, &n_frames), 0);
    assert_int_equal(gsid_link_decode(&link, 1, bytes, 1, NULL, &n_frames), 0);
    assert_int_equal(gsid_link_decode(&link, 1, bytes, 1, &frame, NULL), 0);
    memset(&link, 0xFF, sizeof link); /* never reset */
    assert_int_equal(gsid_link_decode(&link, 1, bytes, 1, &frame, &n_frames), 0);
    assert_int_equal(n_frames, 77);
}

/* A frame whose check is right but whose kind nobody sends is no frame. */
static void an_unknown_kind_is_damage(void **state) {
    (void)state;
    gsid_frame frame = frame_of(GSID_FRAME_STOP, 1, 0, 0);
    uint8_t bytes[GSID_LINK_FRAME_MAX];
    size_t n_frames;
    gsid_link link;
    gsid_link_reset(&link);
    link.session = SESSION;
    gsid_link_encode(&frame, SESSION, bytes);
    bytes[2] = 9;
    const uint16_t check = slow_check(SESSION, bytes + 2, 14);
    bytes[16] = (uint8_t)(check & 0xFF);
    bytes[17] = (uint8_t)(check >> 8);
    gsid_link_decode(&link, BYTES, bytes, 1, &frame, &n_frames);
    assert_int_equal(n_frames, 0);
    assert_int_equal(link.n_damaged, 1);
}

/* What an earlier run left in a buffer on the way: its ticks are those of this run, and its check was right. */
static void a_frame_of_another_session_is_never_accepted(void **state) {
    (void)state;
    uint32_t seed = 9;
    gsid_link link;
    gsid_frame got;
    uint8_t bytes[GSID_LINK_FRAME_MAX];
    size_t n_frames;
    for (uint32_t session = 0; session <= GSID_LINK_SESSION_MAX; session++) {
        const gsid_frame stale = frame_of(GSID_FRAME_SAMPLE, next_random(&seed), 1.0f, 2.0f);
        gsid_link_reset(&link);
        link.session = SESSION;
        gsid_link_encode(&stale, (uint16_t)session, bytes);
        assert_int_equal(gsid_link_decode(&link, BYTES, bytes, 1, &got, &n_frames), BYTES);
        assert_int_equal(n_frames, session == SESSION);
        assert_int_equal(link.n_damaged, session != SESSION);
    }
}

static void hello_is_accepted_in_any_session_and_ends_the_call(void **state) {
    (void)state;
    const gsid_frame hello = frame_of(GSID_FRAME_HELLO, 77, 0, 0), command = frame_of(GSID_FRAME_COMMAND, 0, 1, 2);
    uint8_t bytes[2 * GSID_LINK_FRAME_MAX];
    gsid_frame got[2];
    size_t n_frames;
    gsid_link link;
    gsid_link_reset(&link);
    link.session = SESSION;
    gsid_link_encode(&hello, SESSION, bytes);
    assert_int_equal(bytes[16] | bytes[17] << 8, slow_check(0xFFFF, bytes + 2, 14));
    gsid_link_encode(&command, 77, bytes + BYTES);
    assert_int_equal(gsid_link_decode(&link, 2 * BYTES, bytes, 2, got, &n_frames), BYTES);
    assert_int_equal(n_frames, 1);
    link.session = (uint16_t)got[0].tick;
    assert_int_equal(gsid_link_decode(&link, BYTES, bytes + BYTES, 2, got, &n_frames), BYTES);
    assert_int_equal(n_frames, 1);
    assert_same(&got[0], &command);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_bytes_are_those_of_the_protocol),
        cmocka_unit_test(every_kind_and_value_comes_back),
        cmocka_unit_test(every_error_of_one_and_two_bits_is_found),
        cmocka_unit_test(a_lost_or_added_byte_costs_one_frame),
        cmocka_unit_test(sync_bytes_inside_a_frame_do_no_harm),
        cmocka_unit_test(frames_may_come_in_pieces),
        cmocka_unit_test(a_full_list_leaves_the_rest_of_the_bytes),
        cmocka_unit_test(no_good_frame_is_lost_in_garbage),
        cmocka_unit_test(misuse_is_refused),
        cmocka_unit_test(an_unknown_kind_is_damage),
        cmocka_unit_test(a_frame_of_another_session_is_never_accepted),
        cmocka_unit_test(hello_is_accepted_in_any_session_and_ends_the_call),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
