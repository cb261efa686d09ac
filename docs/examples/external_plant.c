/* A plant in a process of its own: two joints and a flexible boom, in plain C99.
 *
 * M q'' + C q' + K q = u with the joints base and wrist and the boom's modal coordinate p:
 *   J1 base'' + a p'' = u1,  J2 wrist'' + b p'' = u2,  p'' + a base'' + b wrist'' + 2 z w p' + w^2 p = 0.
 * Messages as on the page "A plant of your own behind the bench", on a little-endian machine.
 *   cc -std=c99 -O2 docs/examples/external_plant.c -o external_plant_c -lm
 *   ./flexslew conform --plant -- ./external_plant_c
 */
#include "frames.h"

enum { JOINTS = 2, SIZE = 6, SUBSTEPS = 10 };

static const double J1 = 200.0, J2 = 80.0, A = 8.0, B = 3.0, W = 3.0, Z = 0.01, TIP = 0.3, PERIOD = 0.01;
static const char TEXT[] =
    "{\"protocol\": 1, \"joints\": [{\"name\": \"base\", \"unit\": \"rad\", \"limit\": 20.0},"
    " {\"name\": \"wrist\", \"unit\": \"rad\", \"limit\": 10.0}], \"tips\": [{\"name\": \"boom\", \"unit\": \"m\"}], \"tip_rates\": true}";

/* x = [base, wrist, p, base', wrist', p'] */
static void rates(const double *x, const double *u, double *out)
{
    double force = -2.0 * Z * W * x[5] - W * W * x[2];
    double p = (force - A * u[0] / J1 - B * u[1] / J2) / (1.0 - A * A / J1 - B * B / J2);
    memcpy(out, x + 3, 3 * sizeof *x);
    out[3] = (u[0] - A * p) / J1, out[4] = (u[1] - B * p) / J2;
    out[5] = p;
}

static void advance(double *x, const double *u, double h)
{
    static const double part[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    double k[SIZE] = {0.0}, sum[SIZE] = {0.0}, at[SIZE];
    for (int stage = 0; stage < 4; stage++) {
        for (int i = 0; i < SIZE; i++) at[i] = x[i] + h * part[stage] * k[i];
        rates(at, u, k);
        for (int i = 0; i < SIZE; i++) sum[i] += weight[stage] * k[i];
    }
    for (int i = 0; i < SIZE; i++) x[i] += h / 6.0 * sum[i];
}

int main(void)
{
    static unsigned char body[LARGEST];
    double x[SIZE] = {0.0}, u[JOINTS], period = PERIOD;
    uint32_t kind, epoch, size;
    uint64_t tick;
    while (receive(&kind, &epoch, &tick, body, &size) && kind != SHUTDOWN) {
        if (kind == HELLO) {
            body[size < LARGEST ? size : LARGEST - 1] = 0;
            const char *at = strstr((const char *)body, "\"period\":");
            if (at != NULL && sscanf(at + 9, "%lf", &period) != 1) period = PERIOD;
            answer(DESCRIPTION, 0, 0, TEXT, (uint32_t)strlen(TEXT));
            continue;
        }
        if (kind == RESET) {
            memset(x, 0, sizeof x);
        } else if (kind == EFFORT && size == sizeof u) {
            memcpy(u, body, sizeof u);
            for (int step = 0; step < SUBSTEPS; step++) advance(x, u, period / SUBSTEPS);
            tick++;
        } else {
            answer(ERROR, epoch, tick, "a body of another size", 22);
            continue;
        }
        double m[6] = {x[0], x[1], x[3], x[4], TIP * x[2], TIP * x[5]};
        answer(MEASUREMENT, epoch, tick, m, sizeof m);
    }
    return 0;
}
