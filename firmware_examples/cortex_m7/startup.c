/* Startup code. After a fault the emulator exits with 100 plus the number of the exception. */
#include "board.h"

extern uint32_t stack_end[], data_load[], data_begin[], data_end[], bss_begin[], bss_end[];

void systick_handler(void);
void uart_receive_handler(void);
void uart_transmit_handler(void);

/* Must not use the floating-point unit, which is still off. */
void reset_handler(void);
void reset_handler(void) {
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access */
    __asm volatile("dsb\n isb");
    const uint32_t *from = data_load;
    for (uint32_t *to = data_begin; to < data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = bss_begin; to < bss_end;) {
        *to++ = 0;
    }
    board_exit(main());
}

void fault_handler(void);
void fault_handler(void) {
    uint32_t number;
    __asm volatile("mrs %0, ipsr" : "=r"(number));
    board_exit((int)(100 + number));
}

typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[18] = {
    {.stack = stack_end},         {.handler = reset_handler},        {.handler = fault_handler},
    {.handler = fault_handler},   {.handler = fault_handler},        {.handler = fault_handler},
    {.handler = fault_handler},   {.handler = fault_handler},        {.handler = fault_handler},
    {.handler = fault_handler},   {.handler = fault_handler},        {.handler = fault_handler},
    {.handler = fault_handler},   {.handler = fault_handler},        {.handler = fault_handler},
    {.handler = systick_handler}, {.handler = uart_receive_handler}, {.handler = uart_transmit_handler},
};
