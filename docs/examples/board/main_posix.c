/* The board as a program of this machine: it serves the terminal that its argument names. */
#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <stdio.h>
#include <termios.h>
#include <unistd.h>

#include "line.h"

void board_run(void);

static int line = -1;
static uint8_t sent[2 * LINE_LARGEST];
static size_t waiting = 0;

static void flush_sent(void) {
  size_t done = 0;
  while (done < waiting) {
    ssize_t count = write(line, sent + done, waiting - done);
    if (count <= 0) break;
    done += (size_t)count;
  }
  waiting = 0;
}

int read_byte(void) {
  static uint8_t received[512];
  static ssize_t size = 0, at = 0;
  if (at == size) {
    flush_sent();
    size = read(line, received, sizeof received);
    at = 0;
    if (size <= 0) return -1;
  }
  return received[at++];
}

void write_byte(uint8_t byte) {
  if (waiting == sizeof sent) flush_sent();
  sent[waiting++] = byte;
}

int main(int count, char **arguments) {
  struct termios raw;
  if (count != 2 || (line = open(arguments[1], O_RDWR | O_NOCTTY)) < 0 || tcgetattr(line, &raw) != 0) {
    fprintf(stderr, "usage: %s /dev/ttyX: a terminal that can be opened\n", arguments[0]);
    return 2;
  }
  raw.c_iflag = raw.c_oflag = raw.c_lflag = 0;
  raw.c_cc[VMIN] = 1;
  raw.c_cc[VTIME] = 0;
  (void)tcsetattr(line, TCSANOW, &raw);
  board_run();
  return 0;
}
