/* The floor of a study on csa: 64 flights of 100 s side by side in plain C, three modes, complete
 * equations, under PD, by Runge and Kutta's scheme of order 4 with one step per tick. What a member
 * does besides, metrics to 1e-9 and sensors, is left out.
 *
 * gcc -O3 -march=native -mprefer-vector-width=512 -ffast-math -fopenmp-simd csa_flights.c -lmvec -lm
 * Prints flights per second of processor time, the last yaw of one and its largest tip deflection.
 */
#include <math.h>
#include <stdio.h>
#include <time.h>

enum { BATCH_WIDTH = 64, MODES = 3, N = 2 + MODES, TICKS = 10000, ROUNDS = 5 };

typedef double Row[BATCH_WIDTH];

static const double h = 0.01, j_a = 3972.0, j_1 = 4000.0, j_2 = 5972.0, limit = 150.0;
static const double coupling[MODES] = {107.08658, -18.941637, 7.3614992}, mass[MODES] = {3.0, 3.0, 3.0};
static const double stiffness[MODES] = {0.34339898, 13.486634, 105.73739};
static Row k[MODES], x[2 * N], at[2 * N], slope[2 * N], sum[2 * N], u[2], peak;

static void derivative(Row *restrict y, Row *restrict out) {
#pragma omp simd
  for (int i = 0; i < BATCH_WIDTH; i++) {
    /* a sine as a cosine: gcc makes one call of both, for which it has no vectors */
    double c = cos(y[1][i]), s = cos(y[1][i] - 1.5707963267948966);
    double yaw = y[N][i], pitch = y[N + 1][i], bent = 0.0, rate = 0.0, bound = 0.0, held = 0.0;
    for (int j = 0; j < MODES; j++) {
      bent += coupling[j] * y[2 + j][i];
      rate += coupling[j] * y[N + 2 + j][i];
      bound += coupling[j] / mass[j] * k[j][i] * y[2 + j][i];
      held += coupling[j] * coupling[j] / mass[j];
    }
    double coriolis = -2.0 * s * yaw * pitch;
    double b_0 = u[0][i] + 2.0 * c * s * j_a * yaw * pitch - c * pitch * pitch * bent;
    double b_1 = u[1][i] - c * s * j_a * yaw * yaw - 2.0 * s * yaw * rate;
    double m_00 = j_1 + (j_a - held) * c * c, m_01 = s * bent, det = m_00 * j_2 - m_01 * m_01;
    b_0 += c * (bound + held * coriolis);
    double a_0 = (b_0 * j_2 - m_01 * b_1) / det, a_1 = (m_00 * b_1 - m_01 * b_0) / det;
    for (int j = 0; j < N; j++) out[j][i] = y[N + j][i];
    out[N][i] = a_0;
    out[N + 1][i] = a_1;
    for (int j = 0; j < MODES; j++)
      out[N + 2 + j][i] = -(k[j][i] * y[2 + j][i] + coupling[j] * (c * a_0 + coriolis)) / mass[j];
  }
}

static void fly(void) {
  static const double to[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
  for (int j = 0; j < 2 * N; j++)
    for (int i = 0; i < BATCH_WIDTH; i++) x[j][i] = slope[j][i] = 0.0;
  for (int t = 0; t < TICKS; t++) {
    double goal = t < 2500 ? t / 2500.0 : 1.0;
    for (int i = 0; i < BATCH_WIDTH; i++) {
      u[0][i] = fmin(fmax(460.0 * (goal - x[0][i]) - 920.0 * x[N][i], -limit), limit);
      u[1][i] = fmin(fmax(460.0 * (0.5 * goal - x[1][i]) - 920.0 * x[N + 1][i], -limit), limit);
      double tip = fabs(x[2][i] + x[3][i] + x[4][i]);
      peak[i] = tip > peak[i] ? tip : peak[i];
    }
    for (int stage = 0; stage < 4; stage++) {
      for (int j = 0; j < 2 * N; j++)
        for (int i = 0; i < BATCH_WIDTH; i++) at[j][i] = x[j][i] + to[stage] * h * slope[j][i];
      derivative(at, slope);
      for (int j = 0; j < 2 * N; j++)
        for (int i = 0; i < BATCH_WIDTH; i++)
          sum[j][i] = (stage ? sum[j][i] : 0.0) + weight[stage] * slope[j][i];
    }
    for (int j = 0; j < 2 * N; j++)
      for (int i = 0; i < BATCH_WIDTH; i++) x[j][i] += h / 6.0 * sum[j][i];
  }
}

int main(void) {
  double best = 1e9;
  for (int j = 0; j < MODES; j++)
    for (int i = 0; i < BATCH_WIDTH; i++) k[j][i] = stiffness[j] * (0.8 + 0.4 * i / BATCH_WIDTH);
  for (int round = 0; round < ROUNDS; round++) {
    clock_t start = clock();
    fly();
    double took = (double)(clock() - start) / CLOCKS_PER_SEC;
    best = took < best ? took : best;
  }
  printf("%g %g %g\n", BATCH_WIDTH / best, x[0][0], peak[0]);
  return 0;
}
