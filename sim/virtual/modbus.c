#include "modbus.h"

#include <arpa/inet.h>
#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <math.h>
#include <modbus/modbus.h>
#include <poll.h>
#include <pty.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#define N_REGISTERS 108
#define TARGET      0
#define COMMAND     2
#define SPEED       3
#define ACCEL       4
#define WATCHDOG    5
#define TIMEOUT     VIRTUAL_MODBUS_TIMEOUT
#define UNIT_US     100000 /* unit of the timeout and of pulses */
#define TICK_MS     10     /* resolution of the timeout and of pulses */

#define START 1
#define HOME  2
#define STOP  3
#define CLEAR 4

/* Duration in µs of homing for a drive that already stands on its switch. The drive leaves the
 * switch and comes back. */
#define MIN_HOMING_US 20000

enum phase { STANDING, MOVING, BRAKING, HOMING };

struct VirtualModbus {
    struct virtual_modbus_options options;
    char *bus;
    int port, listener, wire, slave, wake[2], made[2];
    modbus_t *context;
    GThread *thread;

    GMutex mutex; /* guards the following members */
    modbus_mapping_t *mapping;
    struct virtual_modbus_faults faults;
    struct virtual_modbus_state state;
    gboolean quit;
    int down_ms; /* above 0 if a restart was requested */
    enum phase phase;
    double from, to, speed0;
    double speed_steps_s; /* maximum speed of the current motion */
    gint64 start_us, end_us;
    /* Time of the last request. 0 after the communication timeout has expired, until the next
     * request. */
    gint64 heard_us;
    /* time when the coil's pulse ends; 0 if there is none */
    gint64 pulse_end_us[VIRTUAL_MODBUS_BITS];
    int pulse_ms[VIRTUAL_MODBUS_BITS]; /* length of the coil's last pulse */
};

static double modbus_travelled(const VirtualModbus *device, double way, double t) {
    double a = device->options.accel_steps_s2;
    double v = MIN(device->speed_steps_s, sqrt(a * way));
    double ramp = v / a, left = MAX(0, way / v + ramp - t);
    if (t <= ramp)
        return a * t * t / 2;
    return left <= ramp ? way - a * left * left / 2 : v * (t - ramp / 2);
}

static double position_at(const VirtualModbus *device, gint64 now_us) {
    double t = (double)(now_us - device->start_us) * 1e-6, way = device->to - device->from;
    if (device->phase == STANDING || device->faults.blocked)
        return device->state.position_steps;
    if (now_us >= device->end_us || way == 0)
        return device->to;
    if (device->phase == BRAKING)
        return device->from + device->speed0 * t -
               copysign(device->options.accel_steps_s2 * t * t / 2, device->speed0);
    return device->from + copysign(modbus_travelled(device, fabs(way), t), way);
}

static void update_motion(VirtualModbus *device) {
    gint64 now = g_get_monotonic_time();
    device->state.position_steps = position_at(device, now);
    if (device->phase == STANDING || device->faults.blocked || now < device->end_us)
        return;
    if (device->phase == HOMING)
        device->state.homed = TRUE;
    device->phase = STANDING;
}

static void begin_motion(VirtualModbus *device, enum phase phase, double to, gint64 min_us) {
    gint64 now = g_get_monotonic_time();
    double asked = device->options.speed_unit_steps_s * device->mapping->tab_registers[SPEED];
    double v = asked > 0 ? asked : device->options.speed_steps_s;
    double a = device->options.accel_steps_s2;
    double way = fabs(to - device->state.position_steps);
    double seconds = way >= v * v / a ? way / v + v / a : 2 * sqrt(way / a);
    device->phase = phase;
    device->speed_steps_s = v;
    device->from = device->state.position_steps;
    device->to = to;
    device->start_us = device->state.began_us = now;
    device->end_us = now + MAX((gint64)(seconds * 1e6), min_us);
}

static void brake(VirtualModbus *device) {
    gint64 now = g_get_monotonic_time();
    double a = device->options.accel_steps_s2;
    if (device->phase != MOVING && device->phase != HOMING)
        return;
    double before = position_at(device, now - 1000), here = position_at(device, now);
    device->speed0 = (here - before) * 1e3;
    device->from = here;
    device->to = here + device->speed0 * fabs(device->speed0) / (2 * a);
    device->phase = BRAKING;
    device->start_us = now;
    device->end_us = now + (gint64)(fabs(device->speed0) / a * 1e6);
}

/* Does what the device does by itself. Ends pulses. When the communication timeout expires,
 * switches all coils off and brakes the drive. */
static void update_watchdogs(VirtualModbus *device) {
    gint64 now = g_get_monotonic_time();
    gint64 timeout_us = device->mapping->tab_registers[TIMEOUT] * (gint64)UNIT_US;
    for (int i = 0; i < VIRTUAL_MODBUS_BITS; i++) {
        if (device->pulse_end_us[i] == 0 || now < device->pulse_end_us[i])
            continue;
        device->pulse_end_us[i] = 0;
        device->mapping->tab_bits[i] = 0;
        device->state.expired_ms = device->pulse_ms[i];
    }
    if (timeout_us == 0 || device->heard_us == 0 || now < device->heard_us + timeout_us)
        return;
    device->heard_us = 0;
    device->state.timeouts++;
    device->state.expired_ms = (int)(timeout_us / 1000);
    memset(device->mapping->tab_bits, 0, VIRTUAL_MODBUS_BITS);
    memset(device->pulse_end_us, 0, sizeof device->pulse_end_us);
    brake(device);
}

static void modbus_obey(VirtualModbus *device) {
    const guint16 *registers = device->mapping->tab_registers;
    gint32 target = (gint32)((guint32)registers[TARGET] << 16 | registers[TARGET + 1]);
    switch (registers[COMMAND]) {
    case START:
        if (!device->state.faulty)
            begin_motion(device, MOVING, target, 0);
        break;
    case HOME:
        device->state.homed = FALSE;
        if (!device->state.faulty)
            begin_motion(device, HOMING, 0, MIN_HOMING_US);
        break;
    case STOP:
        brake(device);
        break;
    case CLEAR:
        device->state.faulty = FALSE;
        break;
    default:
        break;
    }
}

static void modbus_show(VirtualModbus *device) {
    struct virtual_modbus_state *state = &device->state;
    gint32 position = (gint32)lround(state->position_steps);
    guint16 *at = device->mapping->tab_registers + VIRTUAL_MODBUS_STATUS;
    state->moving = device->phase != STANDING;
    at[0] = (guint16)(state->moving | state->homed << 1 | state->faulty << 2);
    at[1] = (guint16)((guint32)position >> 16);
    at[2] = (guint16)position;
    memcpy(device->mapping->tab_input_registers + VIRTUAL_MODBUS_STATUS, at, 3 * sizeof *at);
    state->speed = device->mapping->tab_registers[SPEED];
    state->accel = device->mapping->tab_registers[ACCEL];
    for (int i = 0; i < VIRTUAL_MODBUS_BITS; i++)
        state->coils[i] = device->mapping->tab_bits[i] != 0;
}

static int pulsed_coil(const guint8 *pdu) {
    int coil = (pdu[1] << 8 | pdu[2]) - VIRTUAL_MODBUS_PULSE;
    return pdu[0] == 5 && coil >= 0 && coil < VIRTUAL_MODBUS_BITS ? coil : -1;
}

/* Carries out what a request does beyond libmodbus, which only writes to its mapping: pulses,
 * commands of the drive, and counters. */
static void react(VirtualModbus *device, const guint8 *query) {
    const guint8 *pdu = query + modbus_get_header_length(device->context);
    int address = pdu[1] << 8 | pdu[2], n_or_value = pdu[3] << 8 | pdu[4];
    int n = pdu[0] == 15 || pdu[0] == 16 ? n_or_value : 1, pulsed = pulsed_coil(pdu);
    if (pulsed >= 0) {
        device->mapping->tab_bits[pulsed] = n_or_value > 0;
        device->pulse_end_us[pulsed] = g_get_monotonic_time() + n_or_value * (gint64)UNIT_US;
        device->pulse_ms[pulsed] = n_or_value * (UNIT_US / 1000);
        device->state.pulses++;
    } else if (pdu[0] == 5 || pdu[0] == 15) {
        for (int i = address; i < address + n && i < VIRTUAL_MODBUS_BITS; i++)
            device->pulse_end_us[i] = 0;
    }
    if (pdu[0] != 6 && pdu[0] != 16)
        return;
    if (address <= COMMAND && COMMAND < address + n)
        modbus_obey(device);
    if (address <= WATCHDOG && WATCHDOG < address + n)
        device->state.watchdogs++;
}

static gboolean due(int *count) {
    if (*count == 0)
        return FALSE;
    if (*count > 0)
        --*count;
    return TRUE;
}

static gboolean is_write(guint8 function) {
    return function == 5 || function == 6 || function == 15 || function == 16;
}

/* Makes a reply without sending it. Returns the length of the reply, or 0 if the device does not
 * reply. */
static int make_reply(VirtualModbus *device, const guint8 *query, int n, int exception,
                      guint8 *ret) {
    if (!exception && pulsed_coil(query + modbus_get_header_length(device->context)) >= 0) {
        /* The reply to a pulse is made here, because libmodbus accepts only the values on and
         * off. */
        memcpy(ret, query, (gsize)n);
        return n;
    }
    modbus_set_socket(device->context, device->made[0]);
    int made;
    if (exception)
        made = modbus_reply_exception(device->context, query, (guint)exception);
    else
        made = modbus_reply(device->context, query, n, device->mapping);
    modbus_set_socket(device->context, device->wire);
    return made > 0 ? (int)recv(device->made[1], ret, MODBUS_TCP_MAX_ADU_LENGTH, MSG_DONTWAIT) : 0;
}

/* Carries out a request and makes the answer, changed by the faults that are set. Returns the
 * length of the answer, or 0 if there is no answer. Sets *ret_hold_us to the time by which the
 * answer must be delayed. */
static int modbus_answer(VirtualModbus *device, const guint8 *query, int n, guint8 *ret,
                         gint64 *ret_hold_us) {
    struct virtual_modbus_faults *faults = &device->faults;
    gboolean good = due(&faults->skip);
    int exception = !good && due(&faults->refused) ? faults->exception : 0;
    guint8 coils[VIRTUAL_MODBUS_BITS];
    device->state.requests++;
    update_motion(device);
    update_watchdogs(device);
    memcpy(coils, device->mapping->tab_bits, sizeof coils);
    device->heard_us = g_get_monotonic_time();
    modbus_show(device);
    int made = make_reply(device, query, n, exception, ret);
    if (!exception && made > 0 && !(ret[modbus_get_header_length(device->context)] & 0x80))
        react(device, query);
    if (faults->deaf)
        memcpy(device->mapping->tab_bits, coils, sizeof coils);
    *ret_hold_us = faults->delay_us;
    if (good || exception)
        return made;
    if (due(&faults->silent))
        return 0;
    if (is_write(query[modbus_get_header_length(device->context)]) && due(&faults->lost)) {
        device->state.usable_us = g_get_monotonic_time() + faults->dead_ms * (gint64)1000;
        return 0;
    }
    if (due(&faults->late))
        *ret_hold_us += faults->late_ms * 1000;
    if (made > 0 && due(&faults->damaged))
        ret[device->options.rtu ? made - 1 : 1] ^= 0x55;
    return made;
}

static void hang_up(VirtualModbus *device) {
    if (device->wire >= 0)
        close(device->wire);
    device->wire = -1;
}

static void modbus_serve(VirtualModbus *device) {
    guint8 query[MODBUS_TCP_MAX_ADU_LENGTH], reply[MODBUS_TCP_MAX_ADU_LENGTH];
    gint64 hold_us = 0;
    modbus_set_socket(device->context, device->wire);
    int n = modbus_receive(device->context, query);
    if (n < 0 && !device->options.rtu)
        hang_up(device);
    int header = modbus_get_header_length(device->context);
    if (n <= 0 || query[header - 1] != device->options.unit)
        return;
    g_mutex_lock(&device->mutex);
    const gboolean dead = device->faults.cut || g_get_monotonic_time() < device->state.usable_us;
    n = dead ? 0 : modbus_answer(device, query, n, reply, &hold_us);
    g_mutex_unlock(&device->mutex);
    if (hold_us > 0)
        g_usleep((gulong)hold_us);
    if (n > 0 && device->options.rtu && write(device->wire, reply, (gsize)n) != n)
        tcflush(device->wire, TCIOFLUSH);
    else if (n > 0 && !device->options.rtu)
        send(device->wire, reply, (gsize)n, MSG_NOSIGNAL);
}

static gboolean start_listening(VirtualModbus *device) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((guint16)device->port)};
    socklen_t size = sizeof address;
    int one = 1;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    device->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    setsockopt(device->listener, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    if (device->listener < 0 || bind(device->listener, (struct sockaddr *)&address, size) != 0 ||
        listen(device->listener, 4) != 0 ||
        getsockname(device->listener, (struct sockaddr *)&address, &size) != 0)
        return FALSE;
    device->port = ntohs(address.sin_port);
    return TRUE;
}

static void stop_listening(VirtualModbus *device) {
    hang_up(device);
    if (device->listener >= 0)
        close(device->listener);
    device->listener = -1;
}

/* Does what other threads have requested. Returns FALSE if the device must end. */
static gboolean follow_orders(VirtualModbus *device) {
    g_mutex_lock(&device->mutex);
    int down_ms = device->down_ms;
    gboolean quit = device->quit;
    device->down_ms = 0;
    if (down_ms > 0) {
        memset(device->mapping->tab_registers, 0, N_REGISTERS * sizeof(guint16));
        memset(device->mapping->tab_bits, 0, VIRTUAL_MODBUS_BITS);
        memset(device->pulse_end_us, 0, sizeof device->pulse_end_us);
        device->phase = STANDING;
        device->state.position_steps = 0;
        device->state.homed = device->state.faulty = FALSE;
    }
    g_mutex_unlock(&device->mutex);
    if (quit || down_ms == 0)
        return !quit;
    if (device->options.rtu) {
        g_usleep((gulong)down_ms * 1000);
        tcflush(device->wire, TCIOFLUSH);
        return TRUE;
    }
    stop_listening(device);
    g_usleep((gulong)down_ms * 1000);
    return start_listening(device);
}

/* Returns the time in ms after which timeouts and pulses must be checked again. Returns −1 if there
 * are none. */
static int wait_ms(VirtualModbus *device) {
    g_mutex_lock(&device->mutex);
    update_motion(device);
    update_watchdogs(device);
    gboolean active = device->mapping->tab_registers[TIMEOUT] != 0 && device->heard_us != 0;
    for (int i = 0; i < VIRTUAL_MODBUS_BITS; i++)
        active |= device->pulse_end_us[i] != 0;
    g_mutex_unlock(&device->mutex);
    return active ? TICK_MS : -1;
}

static gpointer modbus_run(gpointer data) {
    VirtualModbus *device = data;
    char byte;
    for (;;) {
        struct pollfd fds[] = {
            {device->wake[0], POLLIN, 0}, {device->listener, POLLIN, 0}, {device->wire, POLLIN, 0}};
        int ready = poll(fds, G_N_ELEMENTS(fds), wait_ms(device));
        if (ready < 0 && errno != EINTR)
            return NULL;
        if (ready <= 0)
            continue;
        if (fds[0].revents && (read(device->wake[0], &byte, 1) < 0 || !follow_orders(device)))
            return NULL;
        if (fds[0].revents)
            continue;
        if (fds[1].revents) {
            hang_up(device);
            device->wire = accept4(device->listener, NULL, NULL, SOCK_CLOEXEC);
            g_mutex_lock(&device->mutex);
            device->state.connections++;
            g_mutex_unlock(&device->mutex);
        } else if (fds[2].revents) {
            modbus_serve(device);
        }
    }
}

static void modbus_wake(VirtualModbus *device) {
    if (write(device->wake[1], "", 1) < 0)
        g_warning("virtual Modbus device: the device's thread cannot be woken: %s",
                  g_strerror(errno));
}

static gboolean open_wire(VirtualModbus *device) {
    struct termios raw = {0};
    char name[64];
    gboolean ok;
    cfmakeraw(&raw);
    raw.c_cflag |= CS8 | CREAD | CLOCAL;
    if (device->options.rtu) {
        ok = openpty(&device->wire, &device->slave, name, &raw, NULL) == 0;
        device->bus = ok ? g_strdup(name) : NULL;
    } else {
        ok = start_listening(device);
        device->bus = ok ? g_strdup_printf("tcp:127.0.0.1:%d", device->port) : NULL;
    }
    device->context = device->options.rtu ? modbus_new_rtu("/dev/null", 115200, 'E', 8, 1)
                                          : modbus_new_tcp("127.0.0.1", MAX(device->port, 1));
    device->mapping = modbus_mapping_new(VIRTUAL_MODBUS_BITS, VIRTUAL_MODBUS_BITS, N_REGISTERS,
                                         VIRTUAL_MODBUS_STATUS + 3);
    return ok && device->context && device->mapping;
}

VirtualModbus *virtual_modbus_new(const struct virtual_modbus_options *options, GError **error) {
    VirtualModbus *device = g_new0(VirtualModbus, 1);
    device->options = *options;
    device->wire = device->slave = device->listener = -1;
    device->wake[0] = device->wake[1] = device->made[0] = device->made[1] = -1;
    g_mutex_init(&device->mutex);
    if (!g_unix_open_pipe(device->wake, FD_CLOEXEC, error)) {
        virtual_modbus_free(device);
        return NULL;
    }
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, device->made) != 0 ||
        !open_wire(device)) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "virtual Modbus device: no %s can be opened: %s; close other programs",
                    options->rtu ? "pseudo-terminal" : "TCP port", g_strerror(errno));
        virtual_modbus_free(device);
        return NULL;
    }
    modbus_set_slave(device->context, options->unit);
    modbus_set_indication_timeout(device->context, 0, 200000);
    modbus_set_response_timeout(device->context, 0, 1000);
    device->thread = g_thread_new("virtual-modbus", modbus_run, device);
    return device;
}

static void modbus_close_all(const int *fds, int n) {
    for (int i = 0; i < n; i++)
        if (fds[i] >= 0)
            close(fds[i]);
}

void virtual_modbus_free(VirtualModbus *device) {
    if (!device)
        return;
    if (device->thread) {
        g_mutex_lock(&device->mutex);
        device->quit = TRUE;
        g_mutex_unlock(&device->mutex);
        modbus_wake(device);
        g_thread_join(device->thread);
    }
    stop_listening(device);
    modbus_close_all(&device->slave, 1);
    modbus_close_all(device->wake, 2);
    modbus_close_all(device->made, 2);
    if (device->mapping)
        modbus_mapping_free(device->mapping);
    if (device->context)
        modbus_free(device->context);
    g_mutex_clear(&device->mutex);
    g_free(device->bus);
    g_free(device);
}

const char *virtual_modbus_bus(const VirtualModbus *device) {
    return device->bus;
}

void virtual_modbus_fail(VirtualModbus *device, const struct virtual_modbus_faults *faults) {
    g_mutex_lock(&device->mutex);
    update_motion(device);
    device->faults = *faults;
    g_mutex_unlock(&device->mutex);
}

void virtual_modbus_restart(VirtualModbus *device, int down_ms) {
    g_mutex_lock(&device->mutex);
    device->down_ms = MAX(down_ms, 1);
    g_mutex_unlock(&device->mutex);
    modbus_wake(device);
}

void virtual_modbus_state(VirtualModbus *device, struct virtual_modbus_state *ret) {
    g_mutex_lock(&device->mutex);
    update_motion(device);
    update_watchdogs(device);
    modbus_show(device);
    *ret = device->state;
    g_mutex_unlock(&device->mutex);
}

void virtual_modbus_set_input(VirtualModbus *device, int index, gboolean on) {
    g_return_if_fail(index >= 0 && index < VIRTUAL_MODBUS_BITS);
    g_mutex_lock(&device->mutex);
    device->mapping->tab_input_bits[index] = on != FALSE;
    g_mutex_unlock(&device->mutex);
}

void virtual_modbus_set_coil(VirtualModbus *device, int index, gboolean on) {
    g_return_if_fail(index >= 0 && index < VIRTUAL_MODBUS_BITS);
    g_mutex_lock(&device->mutex);
    device->mapping->tab_bits[index] = on != FALSE;
    g_mutex_unlock(&device->mutex);
}

void virtual_modbus_set_plain(VirtualModbus *device, int index, guint16 value) {
    g_return_if_fail(index >= 0 && VIRTUAL_MODBUS_PLAIN + index < N_REGISTERS);
    g_mutex_lock(&device->mutex);
    device->mapping->tab_registers[VIRTUAL_MODBUS_PLAIN + index] = value;
    g_mutex_unlock(&device->mutex);
}

void virtual_modbus_set_drive_fault(VirtualModbus *device, gboolean faulty) {
    g_mutex_lock(&device->mutex);
    update_motion(device);
    device->state.faulty = faulty;
    if (faulty)
        device->phase = STANDING;
    g_mutex_unlock(&device->mutex);
}
