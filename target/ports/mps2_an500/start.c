/* Start of a Cortex-M7 without an operating system: vectors, floating point, memory, and a painted stack. */
#include <stdint.h>
#include <string.h>

extern uint32_t stack_limit[], stack_top[], data_start[], data_end[], data_image[], bss_start[], bss_end[];
int main(void);
void reset(void);

enum { PAINT = 0x5aa5c33c };

static void stop(void) {
    for (;;) {}
}

/* The first two are read by the processor at reset: stack pointer and program. */
__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    stack_top, (void *)reset, (void *)stop, (void *)stop, (void *)stop, (void *)stop, (void *)stop};

__attribute__((naked, noreturn)) void reset(void) {
    __asm__ volatile(
        "ldr r0, =0xe000ed88\n" /* CPACR: full access to the floating-point unit, before anything uses it */
        "ldr r1, [r0]\n orr r1, r1, #0xf00000\n str r1, [r0]\n dsb\n isb\n"
        "ldr r0, =stack_limit\n ldr r1, =stack_top\n ldr r2, =0x5aa5c33c\n"
        "1: cmp r0, r1\n bhs 2f\n str r2, [r0], #4\n b 1b\n"
        "2: bl prepare\n bl main\n 3: b 3b\n .ltorg\n");
}

__attribute__((used)) static void prepare(void) {
    memcpy(data_start, data_image, (size_t)((uint8_t *)data_end - (uint8_t *)data_start));
    memset(bss_start, 0, (size_t)((uint8_t *)bss_end - (uint8_t *)bss_start));
}

/* Bytes of stack that have been used since the reset. */
uint32_t stack_used(void) {
    const uint32_t *lowest = stack_limit;
    while (lowest < stack_top && *lowest == PAINT) lowest++;
    return (uint32_t)((const uint8_t *)stack_top - (const uint8_t *)lowest);
}
