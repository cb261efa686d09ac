/* The hooks of a board on a Cortex-M7 without an operating system: a USART of an STM32F7 or H7.
 * The startup code of its vendor sets clock, pins and baud rate, and calls board_run.
 *   python -m ziglang cc -target thumb-freestanding-eabihf -mcpu=cortex_m7 -std=c99 -Os \
 *     -Wl,-e,board_run -Wl,--gc-sections line.c board.c uart_cortex_m7.c -o board.elf
 */
#include "line.h"

#ifndef USART
#define USART 0x40004800u /* base address of USART3 */
#endif
#define STATUS (*(const volatile uint32_t *)(USART + 0x1Cu))
#define RECEIVED (*(const volatile uint32_t *)(USART + 0x24u))
#define TO_SEND (*(volatile uint32_t *)(USART + 0x28u))
#define HAS_RECEIVED 0x20u
#define CAN_SEND 0x80u

int read_byte(void) {
  while (!(STATUS & HAS_RECEIVED)) {
  }
  return (int)(RECEIVED & 0xFFu);
}

void write_byte(uint8_t byte) {
  while (!(STATUS & CAN_SEND)) {
  }
  TO_SEND = byte;
}
