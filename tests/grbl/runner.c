/*
 * Runs the firmware of a GRBL board in libsimavr, at most in real time. The serial port of the
 * board is a pseudo-terminal. tests/grbl/run builds this program; it is no part of Mesorig.
 *
 *     runner FIRMWARE.elf LINK
 *
 * LINK becomes a link to the pseudo-terminal. A line on standard input is a command, and has a line
 * on standard output as its answer:
 *     position         the steps that the motors of X, Y and Z have made, and the number of Ctrl-X
 *     switch STEPS     the limit switches are pressed from this position on
 *     press 0|1        releases or presses the limit switch of X, wherever the motor is
 *     wire 0|1|2       0: works; 1: what the board sends is lost; 2: nothing passes
 *     reset            pushes the reset button
 * The program ends at the end of its standard input.
 */
#include <errno.h>
#include <fcntl.h>
#include <pty.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#define FREQUENCY 8000000
#define SLICE     (FREQUENCY / 1000) /* cycles between two looks at the host */
#define N_AXES    3

enum { STEP_PIN = 2, DIRECTION_PIN = 5 }; /* of port D; the pins of X */

static const int limit_pins[N_AXES] = {1, 2, 4}; /* of port B */

static avr_t *avr;
static int wire, fault, pressed;
static long steps[N_AXES], switch_steps = 1000000000;
static unsigned port_d, n_resets;
static int may_receive = 1;
static uint8_t waiting[65536]; /* bytes for the board */
static unsigned head, tail;

static void set_input(char port, int pin, int value) {
    avr_irq_t *irq = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), pin);
    avr_raise_irq(irq, value);
}

static void set_limit(int axis) {
    set_input('B', limit_pins[axis], steps[axis] < switch_steps && !(pressed && axis == 0));
}

static void on_pin(struct avr_irq_t *irq, uint32_t value, void *data) {
    const int pin = (int)(intptr_t)data;
    const unsigned before = port_d;
    port_d = value ? port_d | 1u << pin : port_d & ~(1u << pin);
    const int axis = pin - STEP_PIN;
    if (axis < 0 || axis >= N_AXES || !value || before >> pin & 1)
        return;
    steps[axis] += port_d >> (DIRECTION_PIN + axis) & 1 ? -1 : 1;
    set_limit(axis);
}

static void on_sent(struct avr_irq_t *irq, uint32_t value, void *data) {
    const uint8_t byte = (uint8_t)value;
    if (fault == 0 && write(wire, &byte, 1) < 0 && errno != EAGAIN)
        perror("runner");
}

static void feed(void) {
    while (may_receive && head != tail)
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT),
                      waiting[head++ % sizeof waiting]);
}

static void on_flow(struct avr_irq_t *irq, uint32_t value, void *data) {
    may_receive = data != NULL;
    feed();
}

/* The simulator neither prints what the board sends nor sleeps while it waits for input. */
static void set_up_uart(void) {
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_POOL_SLEEP | AVR_UART_FLAG_STDIO);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
}

static void connect_pins(void) {
    static char yes;
    const uint32_t uart = AVR_IOCTL_UART_GETIRQ('0');
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUTPUT), on_sent, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XON), on_flow, &yes);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XOFF), on_flow, NULL);
    for (intptr_t i = 0; i < 8; i++)
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), (int)i), on_pin,
                                (void *)i);
}

/* The pull-ups of the inputs. A change is needed, because simavr ignores the same value again, also
 * after a reset. */
static void release_inputs(void) {
    for (int value = 0; value < 2; value++)
        for (int i = 0; i < 8; i++) {
            set_input('B', i, value);
            set_input('C', i, value);
        }
    for (int i = 0; i < N_AXES; i++)
        set_limit(i);
}

/* Simavr does not start a timer whose compare value is 0, as GRBL leaves it. */
static void start_timer(void) {
    static const avr_io_addr_t addresses[] = {0x89, 0x88}; /* OCR1AH, OCR1AL */
    static const uint8_t values[] = {0x7f, 0xff};
    for (int i = 0; i < 2; i++) {
        const int io = AVR_DATA_TO_IO(addresses[i]);
        if (avr->io[io].w.c)
            avr->io[io].w.c(avr, addresses[i], values[i], avr->io[io].w.param);
        else
            avr->data[addresses[i]] = values[i];
    }
}

static int open_port(const char *link) {
    struct termios raw;
    char name[64];
    int slave; /* stays open, so that the wire does not hang up when a program closes the port */
    memset(&raw, 0, sizeof raw);
    cfmakeraw(&raw);
    raw.c_cflag |= CS8 | CREAD | CLOCAL;
    if (openpty(&wire, &slave, name, &raw, NULL) != 0)
        return 0;
    fcntl(wire, F_SETFL, O_NONBLOCK);
    unlink(link);
    return symlink(name, link) == 0;
}

static void read_port(void) {
    uint8_t bytes[512];
    const ssize_t n = read(wire, bytes, sizeof bytes);
    for (ssize_t i = 0; i < n; i++)
        if (fault < 2) {
            n_resets += bytes[i] == 0x18;
            waiting[tail++ % sizeof waiting] = bytes[i];
        }
    feed();
}

static avr_cycle_count_t timer_due = FREQUENCY / 50;

static void obey(const char *line, FILE *answers) {
    long number = 0;
    if (sscanf(line, "switch %ld", &number) == 1) {
        switch_steps = number;
        for (int i = 0; i < N_AXES; i++)
            set_limit(i);
    } else if (sscanf(line, "press %ld", &number) == 1) {
        pressed = (int)number;
        set_limit(0);
    } else if (sscanf(line, "wire %ld", &number) == 1) {
        fault = (int)number;
    } else if (strcmp(line, "reset") == 0) {
        avr_reset(avr);
        set_up_uart();
        release_inputs();
        timer_due = avr->cycle + FREQUENCY / 50;
    } else if (strcmp(line, "position") != 0) {
        fprintf(answers, "unknown command\n");
        return;
    }
    fprintf(answers, "%ld %ld %ld %u\n", steps[0], steps[1], steps[2], n_resets);
}

/* Returns 0 at the end of standard input. */
static int read_commands(FILE *answers) {
    static char line[128];
    static size_t n;
    char byte;
    ssize_t got;
    while ((got = read(STDIN_FILENO, &byte, 1)) == 1) {
        if (byte != '\n') {
            line[n] = byte;
            n = n + 2 < sizeof line ? n + 1 : n;
            continue;
        }
        line[n] = 0;
        n = 0;
        obey(line, answers);
        fflush(answers);
    }
    return got != 0;
}

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + (double)time.tv_nsec * 1e-9;
}

int main(int argc, char **argv) {
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    /* Simavr writes messages to standard output. */
    FILE *answers = fdopen(dup(STDOUT_FILENO), "w");
    dup2(STDERR_FILENO, STDOUT_FILENO);
    if (argc != 3 || !answers || elf_read_firmware(argv[1], &firmware) != 0 ||
        !(avr = avr_make_mcu_by_name("atmega328p")) || avr_init(avr) != 0 || !open_port(argv[2])) {
        fprintf(stderr, "usage: runner FIRMWARE.elf LINK\n");
        return 1;
    }
    firmware.frequency = FREQUENCY;
    avr_load_firmware(avr, &firmware);
    avr->frequency = FREQUENCY;
    avr->log = LOG_ERROR;
    set_up_uart();
    connect_pins();
    release_inputs();
    fcntl(STDIN_FILENO, F_SETFL, O_NONBLOCK);
    fprintf(answers, "ready\n");
    fflush(answers);
    double begun = now();
    avr_cycle_count_t from = avr->cycle;
    while (read_commands(answers)) {
        const avr_cycle_count_t end = avr->cycle + SLICE;
        while (avr->cycle < end) {
            const int state = avr_run(avr);
            if (state == cpu_Done || state == cpu_Crashed)
                return 2;
        }
        if (timer_due && avr->cycle > timer_due) {
            timer_due = 0;
            start_timer();
        }
        read_port();
        const double ahead = (double)(avr->cycle - from) / FREQUENCY - (now() - begun);
        if (ahead > 0.0005)
            usleep((useconds_t)(ahead * 1e6));
        if (ahead < -0.05) { /* a slow computer does not catch up */
            begun = now();
            from = avr->cycle;
        }
    }
    unlink(argv[2]);
    return 0;
}
