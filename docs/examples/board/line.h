/* Messages over a serial line: COBS frames with CRC-32. C99, no library, no allocation.
 * Implement read_byte and write_byte for your UART; docs/rig.md describes the messages. */
#ifndef LINE_H
#define LINE_H

#include <stddef.h>
#include <stdint.h>

#define LINE_LARGEST 1024 /* of a message with its checksum [B] */
#define LINE_HEADER 20    /* session, kind, epoch (uint32), tick (uint64), little-endian [B] */

enum { AT_SESSION = 0, AT_KIND = 4, AT_EPOCH = 8, AT_TICK = 12 }; /* in a message [B] */
enum { KIND_HELLO = 1, KIND_DESCRIPTION, KIND_RESET, KIND_EFFORT, KIND_MEASUREMENT, KIND_SHUTDOWN };

/* Hooks of the board: the next byte, or -1 when the program must end; send a byte. */
int read_byte(void);
void write_byte(uint8_t byte);

typedef struct {
  uint8_t data[LINE_LARGEST];
  size_t size;
} message;

/* Receive the next whole message; damaged frames are dropped. Return 0 when the program must end. */
int line_receive(message *received);

/* Send a message as a frame. */
void line_send(const message *sent);

uint32_t get_u32(const uint8_t *at);
void put_u32(uint8_t *at, uint32_t value);
double get_f64(const uint8_t *at);
void put_f64(uint8_t *at, double value);

#endif
