/* See line.h. */
#include "line.h"

static uint32_t crc32_of(const uint8_t *data, size_t size) {
  uint32_t crc = 0xFFFFFFFFu;
  for (size_t i = 0; i < size; i++) {
    crc ^= data[i];
    for (int bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ ((crc & 1u) ? 0xEDB88320u : 0u);
  }
  return ~crc;
}

uint32_t get_u32(const uint8_t *at) {
  return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

void put_u32(uint8_t *at, uint32_t value) {
  for (int i = 0; i < 4; i++) at[i] = (uint8_t)(value >> (8 * i));
}

typedef union {
  double number;
  uint64_t bits;
} f64;

double get_f64(const uint8_t *at) {
  f64 value;
  value.bits = (uint64_t)get_u32(at) | (uint64_t)get_u32(at + 4) << 32;
  return value.number;
}

void put_f64(uint8_t *at, double number) {
  f64 value;
  value.number = number;
  put_u32(at, (uint32_t)(value.bits & 0xFFFFFFFFu));
  put_u32(at + 4, (uint32_t)(value.bits >> 32));
}

int line_receive(message *received) {
  for (;;) { /* one frame each: decoded as its bytes come */
    size_t size = 0;
    unsigned left = 0, full = 1; /* bytes left of a block; its zero is left out */
    int good = 1, began = 0, byte;
    while ((byte = read_byte()) > 0) {
      if (left == 0) { /* the length of the next block */
        if (began && !full) {
          if (size < LINE_LARGEST) received->data[size++] = 0;
          else good = 0;
        }
        left = (unsigned)byte - 1u;
        full = byte == 0xFF;
        began = 1;
      } else {
        left--;
        if (size < LINE_LARGEST) received->data[size++] = (uint8_t)byte;
        else good = 0;
      }
    }
    if (byte < 0) return 0;
    if (!began || !good || left != 0 || size < LINE_HEADER + 4) continue;
    if (crc32_of(received->data, size - 4) != get_u32(received->data + size - 4)) continue;
    received->size = size - 4;
    return 1;
  }
}

void line_send(const message *sent) {
  uint8_t crc[4];
  size_t total = sent->size + 4, start = 0;
  put_u32(crc, crc32_of(sent->data, sent->size));
  write_byte(0);
  while (start <= total) { /* blocks of up to 254 bytes without a zero */
    size_t end = start;
    while (end < total && end - start < 254 &&
           (end < sent->size ? sent->data[end] : crc[end - sent->size]) != 0) end++;
    write_byte((uint8_t)(end - start + 1));
    for (size_t i = start; i < end; i++)
      write_byte(i < sent->size ? sent->data[i] : crc[i - sent->size]);
    if (end - start == 254) {
      start = end;
      if (start == total) break;
    } else {
      start = end + 1;
    }
  }
  write_byte(0);
}
