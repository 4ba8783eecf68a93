/* The parts of the MPS2 boards that the example uses (mps2-an500: Cortex-M7, mps2-an386: Cortex-M4F): a serial port, the timer
 * of the tick, and an exit. */
#ifndef BOARD_H
#define BOARD_H

#include <stddef.h>
#include <stdint.h>

/* Enable the serial port and its interrupts, then the timer, at `hz`. */
void board_init(uint32_t hz);

/* Trigger the exception of the tick before the timer does. */
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
