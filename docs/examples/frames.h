/* Frames of a plant or a controller in a process of its own, on a little-endian machine: the length of
 * the message, its kind, epoch and tick, then its body. Nothing else may be printed to the standard output.
 */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

enum { HELLO = 1, DESCRIPTION, RESET, EFFORT, MEASUREMENT, SHUTDOWN, ERROR };
enum { LARGEST = 65536 };

static int receive(uint32_t *kind, uint32_t *epoch, uint64_t *tick, unsigned char *body, uint32_t *size)
{
    unsigned char head[20];
    uint32_t length;
    if (fread(head, 1, sizeof head, stdin) != sizeof head) return 0;
    memcpy(&length, head, 4);
    memcpy(kind, head + 4, 4);
    memcpy(epoch, head + 8, 4);
    memcpy(tick, head + 12, 8);
    if (length < 16 || length - 16 > LARGEST) return 0;
    *size = length - 16;
    return fread(body, 1, *size, stdin) == *size;
}

static void answer(uint32_t kind, uint32_t epoch, uint64_t tick, const void *body, uint32_t size)
{
    unsigned char head[20];
    uint32_t length = 16 + size;
    memcpy(head, &length, 4);
    memcpy(head + 4, &kind, 4);
    memcpy(head + 8, &epoch, 4);
    memcpy(head + 12, &tick, 8);
    fwrite(head, 1, sizeof head, stdout);
    fwrite(body, 1, size, stdout);
    fflush(stdout);
}
