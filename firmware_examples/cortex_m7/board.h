/* What the example needs of the MPS2 boards (mps2-an500: Cortex-M7, mps2-an386: Cortex-M4F): a serial port, the timer of
 * the tick, and a way to end. */
#ifndef BOARD_H
#define BOARD_H

#include <stddef.h>
#include <stdint.h>

/* Serial port and its interrupts on; then the timer, at `hz`. */
void board_init(uint32_t hz);

/* Ask for the tick's exception before its time. */
void board_request_tick(void);

/* Sleep until the next interrupt. */
void board_sleep(void);

/* Under the emulator, or a debugger with semihosting: write text, and leave with an exit status. */
void board_log(const char *text);
void board_exit(int status);

/* The application: called by the receive interrupt, and by the tick's exception. */
void on_byte(uint8_t byte);
void on_tick(int by_timer);

int main(void);

#endif
