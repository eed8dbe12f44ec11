/* Pins for the micro-controller that Klipper simulates in a Linux process. tests/klipper/run puts
 * this file in the place of src/linux/gpio.c of a copy of Klipper. The pins of axis i are 4 i
 * (step), 4 i + 1 (direction), 4 i + 2 (enable) and 4 i + 3 (limit switch). A file that is shared
 * with the test counts the steps of each motor, and says at which step its switch closes. The
 * counts outlive a restart. */
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "command.h"
#include "gpio.h"
#include "internal.h"
#include "sched.h"

#define N_AXES 3
#define N_PINS (4 * N_AXES)

DECL_ENUMERATION_RANGE("pin", "gpio0", 0, N_PINS);

struct gpio_line {
    int pin, value;
};
static struct gpio_line lines[N_PINS];

static struct shared { int64_t steps[N_AXES], switch_at[N_AXES]; } * shared;

static void share(void) {
    if (shared)
        return;
    int fd = open(getenv("KLIPPER_PINS"), O_RDWR | O_CLOEXEC);
    shared =
        fd < 0 ? MAP_FAILED : mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (shared == MAP_FAILED)
        abort();
}

struct gpio_out gpio_out_setup(uint32_t pin, uint8_t value) {
    share();
    if (pin >= N_PINS)
        shutdown("Not an output pin");
    lines[pin] = (struct gpio_line){(int)pin, !!value};
    return (struct gpio_out){&lines[pin]};
}

void gpio_out_reset(struct gpio_out out, uint8_t value) {
    out.line->value = !!value;
}

/* A rising edge is a step. */
void gpio_out_write(struct gpio_out out, uint8_t value) {
    const int axis = out.line->pin / 4;
    if (out.line->pin % 4 == 0 && value && !out.line->value)
        shared->steps[axis] += lines[4 * axis + 1].value ? 1 : -1;
    out.line->value = !!value;
}

void gpio_out_toggle_noirq(struct gpio_out out) {
    gpio_out_write(out, !out.line->value);
}

void gpio_out_toggle(struct gpio_out out) {
    gpio_out_toggle_noirq(out);
}

struct gpio_in gpio_in_setup(uint32_t pin, int8_t pull_up) {
    share();
    if (pin >= N_PINS)
        shutdown("Not an input pin");
    lines[pin].pin = (int)pin;
    return (struct gpio_in){&lines[pin]};
}

void gpio_in_reset(struct gpio_in in, int8_t pull_up) {
}

uint8_t gpio_in_read(struct gpio_in in) {
    const int axis = in.line->pin / 4;
    return shared->steps[axis] >= shared->switch_at[axis];
}
