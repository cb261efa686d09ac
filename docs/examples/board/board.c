/* A controller on a serial line: PD with feedforward for two joints and two tips (trial m1).
 * Replace `step` by your own law. Repeated questions get the stored answer: the law runs once.
 * HELLO begins a session; questions of another one, from an earlier run on the line, are dropped. */
#include "line.h"

#define JOINTS 2
#define TIPS 2
#define NUMBERS (6 * JOINTS + 2 * TIPS)

static const double KP[JOINTS] = {460.0, 460.0}; /* [N m/rad] */
static const double KD[JOINTS] = {920.0, 920.0}; /* [N m s/rad] */

static const char DESCRIPTION[] = "{\"protocol\": 1, \"name\": \"pd_board\", \"numbers\": 16, \"efforts\": 2}";

/* The efforts of one tick [N m]. The members follow the order of the body. */
static void step(const double *numbers, double *effort) {
  const double *position = numbers, *velocity = numbers + JOINTS;
  const double *reference = numbers + 3 * JOINTS + 2 * TIPS; /* behind tips, curvatures, applied */
  const double *rate = reference + JOINTS, *feedforward = rate + JOINTS;
  for (int i = 0; i < JOINTS; i++)
    effort[i] = feedforward[i] + KP[i] * (reference[i] - position[i]) + KD[i] * (rate[i] - velocity[i]);
}

static int same_question(const message *a, const message *b) {
  if (a->size != b->size) return 0;
  for (size_t i = 0; i < a->size; i++)
    if (a->data[i] != b->data[i]) return 0;
  return 1;
}

/* Answer a question; return whether it has an answer. */
static int answer_to(const message *question, message *answer) {
  size_t body = question->size - LINE_HEADER;
  double numbers[NUMBERS], effort[JOINTS];
  for (size_t i = 0; i < LINE_HEADER; i++) answer->data[i] = question->data[i];
  answer->size = LINE_HEADER;
  switch (get_u32(question->data + AT_KIND)) {
    case KIND_HELLO:
      put_u32(answer->data + AT_KIND, KIND_DESCRIPTION);
      for (size_t i = 0; i < sizeof DESCRIPTION - 1; i++)
        answer->data[answer->size++] = (uint8_t)DESCRIPTION[i];
      return 1;
    case KIND_RESET: /* a law with memory restarts here, from the effort of the body */
      return 1;
    case KIND_MEASUREMENT:
      if (body != 8 * NUMBERS) return 0;
      for (size_t i = 0; i < NUMBERS; i++) numbers[i] = get_f64(question->data + LINE_HEADER + 8 * i);
      step(numbers, effort);
      put_u32(answer->data + AT_KIND, KIND_EFFORT);
      for (size_t i = 0; i < JOINTS; i++, answer->size += 8) put_f64(answer->data + answer->size, effort[i]);
      return 1;
    default:
      return 0;
  }
}

/* Serve the line until read_byte returns -1 or the bench ends. */
void board_run(void);
void board_run(void) {
  static message question, last, answer; /* 3 KiB, not on the stack */
  uint32_t session = 0;
  int begun = 0, answered = 0;
  last.size = 0;
  while (line_receive(&question)) {
    uint32_t kind = get_u32(question.data + AT_KIND), of = get_u32(question.data + AT_SESSION);
    if (kind == KIND_HELLO) session = of, begun = 1;
    if (!begun || of != session) continue;
    if (kind == KIND_SHUTDOWN) return;
    if (!same_question(&question, &last)) {
      answered = answer_to(&question, &answer);
      last.size = question.size;
      for (size_t i = 0; i < question.size; i++) last.data[i] = question.data[i];
    }
    if (answered) line_send(&answer);
  }
}
