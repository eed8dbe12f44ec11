/*
 * Runs the firmware of contrib/led-controller in libsimavr, at most in real time. The serial port
 * of the board is a pseudo-terminal. tests/led_controller/run builds this program; it is no part of
 * Mesorig.
 *
 *     runner FIRMWARE.elf LINK
 *
 * LINK becomes a link to the pseudo-terminal. A line on standard input is a command. Its answer has
 * the levels of the pins of lamps 0 to 5, each 0 to 255, the time of the board in ms, and the time
 * at which the last lamp went off. A pin that a timer operates has the level of its compare
 * register:
 *     state            nothing else
 *     wire 0|1|2       0: works; 1: what the board sends is lost; 2: nothing passes
 *     reset            pushes the reset button
 *     hang             the firmware is in an endless loop from now on, without interrupts
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
#define N_LAMPS   6

/* The pins 3, 5, 6, 9, 10, 11 of an Arduino Uno, and the registers of their timers in an
 * ATmega328P: the bit of TCCRnA that connects the pin, and OCRnx. */
static const struct {
    char port;
    int pin, control, bit, compare;
} pins[N_LAMPS] = {{'D', 3, 0xb0, 5, 0xb4}, {'D', 5, 0x44, 5, 0x48}, {'D', 6, 0x44, 7, 0x47},
                   {'B', 1, 0x80, 7, 0x88}, {'B', 2, 0x80, 5, 0x8a}, {'B', 3, 0xb0, 7, 0xb3}};

static avr_t *avr;
static int wire, fault;
static int may_receive = 1;
static uint8_t waiting[65536]; /* bytes for the board */
static unsigned head, tail;
static uint64_t dark_cycle;
static int lit;

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
    static char yes;
    uint32_t flags = 0;
    const uint32_t uart = AVR_IOCTL_UART_GETIRQ('0');
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_POOL_SLEEP | AVR_UART_FLAG_STDIO);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUTPUT), on_sent, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XON), on_flow, &yes);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XOFF), on_flow, NULL);
}

static int level_of(int lamp) {
    avr_ioport_state_t state;
    if (avr_ioctl(avr, AVR_IOCTL_IOPORT_GETSTATE(pins[lamp].port), &state) != 0)
        return 0;
    if (!(state.ddr >> pins[lamp].pin & 1))
        return 0;
    if (avr->data[pins[lamp].control] >> pins[lamp].bit & 1)
        return avr->data[pins[lamp].compare];
    return state.port >> pins[lamp].pin & 1 ? 255 : 0;
}

static void watch_pins(void) {
    int now = 0;
    for (int i = 0; i < N_LAMPS; i++)
        now |= level_of(i);
    if (lit && !now)
        dark_cycle = avr->cycle;
    lit = now;
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
        if (fault < 2)
            waiting[tail++ % sizeof waiting] = bytes[i];
    feed();
}

/* Jumps to an endless loop at the end of the flash. */
static void hang(void) {
    const avr_flashaddr_t at = avr->flashend - 1;
    avr->flash[at] = 0xff; /* rjmp .-2 */
    avr->flash[at + 1] = 0xcf;
    avr->sreg[S_I] = 0;
    avr->pc = at;
}

static void obey(const char *line, FILE *answers) {
    int number = 0;
    if (sscanf(line, "wire %d", &number) == 1) {
        fault = number;
    } else if (strcmp(line, "reset") == 0) {
        avr_reset(avr);
    } else if (strcmp(line, "hang") == 0) {
        hang();
    } else if (strcmp(line, "state") != 0) {
        fprintf(answers, "unknown command\n");
        return;
    }
    for (int i = 0; i < N_LAMPS; i++)
        fprintf(answers, "%d ", level_of(i));
    fprintf(answers, "%.1f %.1f\n", (double)avr->cycle / (FREQUENCY / 1000),
            (double)dark_cycle / (FREQUENCY / 1000));
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
        watch_pins();
        read_port();
        const double ahead = (double)(avr->cycle - from) / FREQUENCY - (now() - begun);
        if (ahead > 0.0005)
            usleep((useconds_t)(ahead * 1e6));
        if (ahead < -0.05 || ahead > 1) { /* a slow computer does not catch up; a reset */
            begun = now();
            from = avr->cycle;
        }
    }
    unlink(argv[2]);
    return 0;
}
