/* A controller in a process of its own: PD with the feedforward of the plan for two joints and two tips.
 * Messages as on the page "A controller as a program". Replace `step` by your own law.
 *   cc -std=c99 -O2 -ffp-contract=off docs/examples/external_controller.c -o external_controller_c
 */
#include "frames.h"

enum { JOINTS = 2, TIPS = 2, NUMBERS = 6 * JOINTS + 2 * TIPS };

static const double KP[JOINTS] = {460.0, 460.0}; /* [N m/rad] */
static const double KD[JOINTS] = {920.0, 920.0}; /* [N m s/rad] */
static const char TEXT[] = "{\"protocol\": 1, \"numbers\": 16, \"efforts\": 2}";

/* The efforts of one tick [N m]: u = u_ff + Kp (r - q) + Kd (r' - q') */
static void step(const double *numbers, double *effort)
{
    const double *position = numbers, *velocity = numbers + JOINTS;
    const double *reference = numbers + 3 * JOINTS + 2 * TIPS; /* behind tips, curvatures, applied */
    const double *rate = reference + JOINTS, *feedforward = rate + JOINTS;
    for (int i = 0; i < JOINTS; i++)
        effort[i] = feedforward[i] + KP[i] * (reference[i] - position[i]) + KD[i] * (rate[i] - velocity[i]);
}

int main(void)
{
    static unsigned char body[LARGEST];
    double numbers[NUMBERS], effort[JOINTS];
    uint32_t kind, epoch, size;
    uint64_t tick;
    while (receive(&kind, &epoch, &tick, body, &size) && kind != SHUTDOWN) {
        if (kind == HELLO) {
            answer(DESCRIPTION, 0, 0, TEXT, (uint32_t)strlen(TEXT));
        } else if (kind == RESET) { /* a law with memory restarts here, from the efforts in the body */
            answer(RESET, epoch, tick, body, 0);
        } else if (kind == MEASUREMENT && size == sizeof numbers) {
            memcpy(numbers, body, sizeof numbers);
            step(numbers, effort);
            answer(EFFORT, epoch, tick, effort, sizeof effort);
        } else {
            answer(ERROR, epoch, tick, "a body of another size", 22);
        }
    }
    return 0;
}
