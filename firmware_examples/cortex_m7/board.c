#include "board.h"

#include "../rate_loop/drive.h"
#include "../rate_loop/handover.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))

/* CMSDK UART 0, whose receive and transmit interrupts are 0 and 1. */
#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u)
#define UART_CTRL REGISTER(0x40004008u)
#define UART_INT REGISTER(0x4000400Cu)
#define UART_BAUDDIV REGISTER(0x40004010u)
#define STATE_TX_FULL 1u
#define STATE_RX_FULL 2u
#define CTRL_ALL 0xFu /* both directions, both interrupts */
#define INT_TX 1u
#define INT_RX 2u

#define SYSTICK_CTRL REGISTER(0xE000E010u)
#define SYSTICK_LOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define SYSTICK_HAS_COUNTED (1u << 16) /* since CTRL was read last */
#define NVIC_ENABLE REGISTER(0xE000E100u)
#define NVIC_PRIORITY REGISTER(0xE000E400u) /* of interrupts 0 to 3, a byte each */
#define ICSR REGISTER(0xE000ED04u)
#define ICSR_SET_SYSTICK (1u << 26)
#define SYSTEM_PRIORITY_3 REGISTER(0xE000ED20u) /* SysTick in the top byte */
#define CLOCK_HZ 25000000u
#define BAUD 921600u

/* Bytes on their way out: the transmit interrupt alone moves `n_gone`, the sender alone `n_put`. */
enum { ROOM = 256 };
static uint8_t waiting[ROOM];
static volatile uint32_t n_put, n_gone;

/* Priorities: the serial port above the tick, which may take long; both above the background. */
void board_init(uint32_t hz) {
    UART_BAUDDIV = CLOCK_HZ / BAUD;
    UART_CTRL = CTRL_ALL;
    (void)UART_DATA; /* the emulator accepts the first byte only after a read */
    NVIC_PRIORITY = 0x4040u;
    SYSTEM_PRIORITY_3 = 0x80u << 24;
    NVIC_ENABLE = 3u;
    SYSTICK_LOAD = CLOCK_HZ / hz - 1;
    SYSTICK_VALUE = 0;
    SYSTICK_CTRL = 7u; /* the processor's clock, interrupt, on */
}

void board_request_tick(void) {
    ICSR = ICSR_SET_SYSTICK;
}

void board_sleep(void) {
    __asm volatile("wfi");
}

void systick_handler(void);
void systick_handler(void) {
    on_tick((SYSTICK_CTRL & SYSTICK_HAS_COUNTED) != 0);
}

void uart_receive_handler(void);
void uart_receive_handler(void) {
    UART_INT = INT_RX;
    while (UART_STATE & STATE_RX_FULL) {
        on_byte((uint8_t)UART_DATA);
    }
}

/* Fill the port as long as it accepts bytes. When it is idle no interrupt occurs: line_send then triggers one. */
void uart_transmit_handler(void);
void uart_transmit_handler(void) {
    UART_INT = INT_TX;
    while (n_gone != n_put && !(UART_STATE & STATE_TX_FULL)) {
        UART_DATA = waiting[n_gone % ROOM];
        n_gone++;
    }
}

size_t line_room(void) {
    return ROOM - (n_put - n_gone);
}

void line_send(const uint8_t *bytes, size_t n_bytes) {
    if (n_bytes > line_room()) {
        return;
    }
    for (size_t i = 0; i < n_bytes; i++) {
        waiting[(n_put + i) % ROOM] = bytes[i];
    }
    HANDOVER();
    n_put += (uint32_t)n_bytes;
    REGISTER(0xE000E200u) = 2u; /* set pending: the transmit interrupt sends the first byte */
}

/* ---- semihosting ---- */

static void semihost(uint32_t operation, const void *argument) {
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

void board_log(const char *text) {
    semihost(0x04, text);
}

void board_exit(int status) {
    const uint32_t block[2] = {0x20026u, (uint32_t)status};
    semihost(0x20, block);
    for (;;) {
    }
}
