/* Drives an exported model with a fixed signal and prints the bits of its response, on the emulated board or on a computer. */
#include <string.h>

#include "exported.h"

#ifdef ON_BOARD
#include "../cortex_m7/board.h"
void on_byte(uint8_t byte) {
    (void)byte;
}
void on_tick(int by_timer) {
    (void)by_timer;
}
#define PRINT board_log
#else
#include <stdio.h>
#define PRINT(text) fputs(text, stdout)
#endif

static void print_bits(float value) {
    static const char digit[] = "0123456789abcdef";
    unsigned bits;
    char text[10];
    memcpy(&bits, &value, sizeof bits);
    for (int i = 0; i < 8; i++) {
        text[i] = digit[bits >> (28 - 4 * i) & 0xFu];
    }
    text[8] = '\n';
    text[9] = 0;
    PRINT(text);
}

int main(void) {
    static exported model;
    exported_reset(&model);
    unsigned seed = 1;
    for (int n = 0; n < 600; n++) {
        seed = 1664525u * seed + 1013904223u;
        const float u = (float)(int)(seed >> 16 & 0xFFu) - 128.0f;
        print_bits(exported_step(&model, u));
#ifdef EXPORTED_HAS_FEEDFORWARD
        print_bits(exported_feedforward(u, 0.0f));
#endif
    }
    return 0;
}
