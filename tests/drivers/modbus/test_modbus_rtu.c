#include "lib/modbus_rig.h"

#include "lib/ok.h"
#include "lib/wait.h"
#include "modbus/line.h"
#include "modbus/serial.h"

#include <errno.h>
#include <fcntl.h>
#include <modbus/modbus.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

/* Drivers over RTU, and a problem that only RTU has: answers that cannot be distinguished. */

/* A request is repeated after TIMEOUT_MS. A busy computer may run the device, or this program, so
 * late that an answer is late which should not be, or in time which should be late. Tests repeat
 * what did not come about because of that, and never believe a wrong value. */
#define TIMEOUT_MS 120
#define LATE_MS    300
/* For tests in which no answer is late. */
#define PATIENT_MS 1000

/* A device of a class that only has a name and a clock, to open lines for. */
struct opened {
    VirtualModbus *device;
    Clock *clock;
    Config *config;
    struct modbus_link link;
    ModbusBus *bus;
};

/* Takes the device. */
static void begin_with(struct opened *opened, VirtualModbus *served, double timeout_ms,
                       int retries) {
    static const struct driver_info info = {"axis", "test", "A test"};
    *opened = (struct opened){.device = served, .clock = clock_new_real()};
    opened->config = config_parse("[axis test]\nbus = x\n", "./test.conf", NULL);
    struct device device = {&info, "test", opened->clock, NULL,
                            config_find(opened->config, "axis", NULL)};
    opened->link = (struct modbus_link){.bus = (char *)virtual_modbus_bus(opened->device),
                                        .baud = 115200,
                                        .parity = 1,
                                        .stop_bits = 1,
                                        .unit = RIG_UNIT,
                                        .timeout_ms = timeout_ms,
                                        .late_ms = LATE_MS,
                                        .retries = retries};
    opened->bus = ok(modbus_bus_get(&opened->link, &device, ERR));
    virtual_modbus_set_plain(opened->device, 0, 111);
    virtual_modbus_set_plain(opened->device, 1, 222);
}

static void begin(struct opened *opened, gconstpointer unused) {
    begin_with(opened, modbus_rig_device(TRUE), TIMEOUT_MS, 3);
}

static void begin_patient(struct opened *opened, gconstpointer unused) {
    begin_with(opened, modbus_rig_device(TRUE), PATIENT_MS, 3);
}

static void end(struct opened *opened, gconstpointer unused) {
    modbus_bus_unref(opened->bus);
    virtual_modbus_free(opened->device);
    clock_unref(opened->clock);
    config_free(opened->config);
}

static gboolean read_plain(struct opened *opened, int index, guint16 *ret, GError **error) {
    struct modbus_job job = {0};
    modbus_job_add(&job, MODBUS_READ_HOLDING, VIRTUAL_MODBUS_PLAIN + index, 1);
    gboolean ok = modbus_bus_do(opened->bus, &opened->link, &job, 4500, error);
    *ret = job.requests[0].values[0];
    return ok;
}

static void expect_plain(struct opened *opened, int index, guint16 value) {
    guint16 got;
    ok(read_plain(opened, index, &got, ERR));
    g_assert_cmpuint(got, ==, value);
}

/* The hazard is real: libmodbus alone takes the late answer for that to the next request. */
static void raw_is_fooled(void) {
    g_autoptr(VirtualModbus) device = modbus_rig_device(TRUE);
    struct virtual_modbus_faults late = {.late = 1, .late_ms = 180};
    guint16 value = 0;
    virtual_modbus_set_plain(device, 0, 111);
    virtual_modbus_set_plain(device, 1, 222);
    modbus_t *raw = modbus_new_rtu(virtual_modbus_bus(device), 115200, 'E', 8, 1);
    modbus_set_slave(raw, RIG_UNIT);
    modbus_set_response_timeout(raw, 0, TIMEOUT_MS * 1000);
    g_assert_cmpint(modbus_connect(raw), ==, 0);
    UNTIL (value == 111) {
        modbus_flush(raw);
        virtual_modbus_fail(device, &late);
        if (modbus_read_registers(raw, VIRTUAL_MODBUS_PLAIN, 1, &value) >= 0) {
            value = 0; /* this program ran too late to see that the answer was late */
            continue;
        }
        g_assert_cmpint(errno, ==, ETIMEDOUT);
        if (modbus_read_registers(raw, VIRTUAL_MODBUS_PLAIN + 1, 1, &value) < 0)
            value = 0; /* the device ran later still */
    }
    modbus_close(raw);
    modbus_free(raw);
}

static void late_is_asked_again(struct opened *opened, gconstpointer unused) {
    struct virtual_modbus_faults late = {.late = 1, .late_ms = 180};
    struct modbus_counts before, counts = {0};
    gboolean asked_again = FALSE;
    UNTIL (asked_again) {
        before = counts;
        virtual_modbus_fail(opened->device, &late);
        expect_plain(opened, 0, 111);
        expect_plain(opened, 1, 222);
        modbus_bus_counts(opened->bus, &counts);
        asked_again = counts.timeouts == before.timeouts + 1;
    }
}

/* Asks until there is an answer, which must be right: without retries, a busy computer makes any
 * request fail. */
static void expect_plain_at_last(struct opened *opened, int index, guint16 value) {
    g_autoptr(GError) error = NULL;
    guint16 got;
    UNTIL (read_plain(opened, index, &got, &error)) {
        g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
        g_clear_error(&error);
    }
    g_assert_cmpuint(got, ==, value);
}

/* Without a retry the request fails; its answer must not pass for that to the next one. */
static void late_is_not_the_next(void) {
    static const int delays_ms[] = {135, 180, 240, 330, 390};
    int n_late = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(delays_ms); i++) {
        struct virtual_modbus_faults late = {.late = 1, .late_ms = delays_ms[i]};
        struct opened opened;
        GError *error = NULL;
        guint16 value;
        begin_with(&opened, modbus_rig_device(TRUE), TIMEOUT_MS, 0);
        virtual_modbus_fail(opened.device, &late);
        /* A busy machine may wake this too late to see that it was late. */
        if (read_plain(&opened, 0, &value, &error)) {
            g_assert_cmpuint(value, ==, 111);
        } else {
            n_late++;
            g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
        }
        g_clear_error(&error);
        expect_plain_at_last(&opened, 1, 222);
        expect_plain_at_last(&opened, 0, 111);
        end(&opened, NULL);
    }
    g_assert_cmpint(n_late, >, 0);
}

/* A device that is held up, as a program is on a busy machine, and then answers all that it was
 * asked meanwhile at the same time: it lives, so its answers do not count as damaged or missing
 * ones. */
static void held_up_is_asked_again(void) {
    static const struct virtual_modbus_faults held_up[] = {{.late = 1, .late_ms = 500},
                                                           {.late = 1, .late_ms = 1000}};
    for (gsize i = 0; i < G_N_ELEMENTS(held_up); i++) {
        struct opened opened;
        begin_with(&opened, modbus_rig_device(TRUE), TIMEOUT_MS, 2);
        virtual_modbus_fail(opened.device, &held_up[i]);
        expect_plain(&opened, 0, 111);
        expect_plain(&opened, 1, 222);
        end(&opened, NULL);
    }
}

/* One that always is, is not asked for ever, and the error says what is wrong. Its answers come in
 * the middle of the time for late ones, from 120 to 420 ms. */
static void always_held_up_is_an_error(struct opened *opened, gconstpointer unused) {
    struct virtual_modbus_faults late = {.late = -1, .late_ms = 270};
    GError *error = NULL;
    guint16 value;
    virtual_modbus_fail(opened->device, &late);
    UNTIL (error != NULL && strstr(error->message, "answers come too late")) {
        g_clear_error(&error);
        if (read_plain(opened, 0, &value, &error))
            g_assert_cmpuint(value, ==, 111);
        else
            g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    }
    g_clear_error(&error);
    late.late = 0;
    virtual_modbus_fail(opened->device, &late);
    g_usleep(G_USEC_PER_SEC); /* it answers what it was asked */
    expect_plain(opened, 1, 222);
}

static int n_requests(VirtualModbus *device) {
    struct virtual_modbus_state state;
    virtual_modbus_state(device, &state);
    return state.requests;
}

struct change {
    VirtualModbus *device;
    int n_requests;
};

/* Changes the value after the device has made the answer to its next request. */
static gpointer change_later(gpointer data) {
    const struct change *change = data;
    UNTIL (n_requests(change->device) > change->n_requests)
        g_usleep(1000);
    virtual_modbus_set_plain(change->device, 0, 333);
    return NULL;
}

/* Later than the line waits: the old answer comes while the question is asked anew, with a value
 * that is true no more. That a second answer follows gives it away. A busy machine may ask so late
 * that the line was quiet before. */
static void very_late_is_disbelieved(struct opened *opened, gconstpointer unused) {
    struct virtual_modbus_faults late = {.late = 1, .late_ms = 465};
    struct modbus_counts counts = {0};
    UNTIL (counts.disbelieved >= 1) {
        struct change change = {opened->device, n_requests(opened->device)};
        virtual_modbus_set_plain(opened->device, 0, 111);
        virtual_modbus_fail(opened->device, &late);
        GThread *thread = g_thread_new("change", change_later, &change);
        expect_plain(opened, 0, 333);
        g_thread_join(thread);
        modbus_bus_counts(opened->bus, &counts);
        expect_plain(opened, 1, 222);
    }
}

static void damaged_is_repeated(struct opened *opened, gconstpointer unused) {
    struct virtual_modbus_faults damaged = {.damaged = 2};
    struct modbus_counts counts;
    GError *error = NULL;
    guint16 value;
    virtual_modbus_fail(opened->device, &damaged);
    expect_plain(opened, 0, 111);
    modbus_bus_counts(opened->bus, &counts);
    g_assert_cmpint(counts.damaged, ==, 2);
    damaged.damaged = -1;
    virtual_modbus_fail(opened->device, &damaged);
    g_assert_false(read_plain(opened, 0, &value, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    g_assert_nonnull(strstr(error->message, "unit 7, reading holding register 100 (0x0064)"));
    g_assert_nonnull(strstr(error->message, "4 tries"));
    g_assert_nonnull(strstr(error->message, "termination"));
    g_clear_error(&error);
    modbus_bus_counts(opened->bus, &counts);
    g_assert_cmpint(counts.damaged, ==, 6);
    damaged.damaged = 0;
    virtual_modbus_fail(opened->device, &damaged);
    expect_plain(opened, 1, 222);
}

static void note(const struct modbus_job *job, const GError *error, gpointer data) {
    g_assert_no_error(error);
    g_string_append_printf(data, "%d ", job->requests[0].address - VIRTUAL_MODBUS_PLAIN);
}

/* Commands keep their order, polls come last, results come from the main loop only. */
static void order(struct opened *opened, gconstpointer unused) {
    g_autoptr(GString) text = g_string_new(NULL);
    struct virtual_modbus_faults slow = {.delay_us = 5000};
    virtual_modbus_fail(opened->device, &slow);
    static const struct {
        int index;
        gboolean poll;
    } jobs[] = {{0, FALSE}, {1, TRUE}, {2, FALSE}, {3, TRUE}, {4, FALSE}};
    for (gsize i = 0; i < G_N_ELEMENTS(jobs); i++) {
        struct modbus_job job = {0};
        modbus_job_add(&job, MODBUS_READ_HOLDING, VIRTUAL_MODBUS_PLAIN + jobs[i].index, 1);
        modbus_bus_start(opened->bus, &opened->link, &job, jobs[i].poll, 4500, note, text);
    }
    g_usleep(100000);
    g_assert_cmpuint(text->len, ==, 0);
    while (text->len < 10)
        g_main_context_iteration(NULL, TRUE);
    g_assert_cmpstr(text->str, ==, "0 2 4 1 3 ");
    struct modbus_job job = {0};
    modbus_job_add(&job, MODBUS_READ_HOLDING, VIRTUAL_MODBUS_PLAIN, 1);
    modbus_bus_start(opened->bus, &opened->link, &job, FALSE, 4500, note, text);
    modbus_bus_cancel(opened->bus, text);
    conformance_pass(opened->clock, 0.05);
    g_assert_cmpuint(text->len, ==, 10);
}

static void note_failed(const struct modbus_job *job, const GError *error, gpointer data) {
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_string_append(data, "failed ");
}

/* A request that is not answered holds up the line for longer than what waits behind it may take.
 */
static void waiting_does_not_count(struct opened *opened, gconstpointer unused) {
    g_autoptr(GString) text = g_string_new(NULL);
    struct virtual_modbus_faults silent = {.silent = 4};
    virtual_modbus_fail(opened->device, &silent);
    struct modbus_job job = {0};
    modbus_job_add(&job, MODBUS_READ_HOLDING, VIRTUAL_MODBUS_PLAIN, 1);
    modbus_bus_start(opened->bus, &opened->link, &job, FALSE, 4500, note_failed, text);
    modbus_bus_start(opened->bus, &opened->link, &job, FALSE, 300, note, text);
    while (text->len < 9)
        g_main_context_iteration(NULL, TRUE);
    g_assert_cmpstr(text->str, ==, "failed 0 ");
}

/* A program that was killed leaves its settings behind; a pseudo-terminal has no parity to set. */
static void left_behind(void) {
    struct opened opened;
    g_autoptr(VirtualModbus) device = modbus_rig_device(TRUE);
    struct termios settings;
    int fd = open(virtual_modbus_bus(device), O_RDWR | O_NOCTTY | O_CLOEXEC);
    g_assert_cmpint(fd, >=, 0);
    g_assert_cmpint(tcgetattr(fd, &settings), ==, 0);
    cfsetspeed(&settings, B115200);
    settings.c_iflag = INPCK;
    settings.c_cflag |= CREAD | CLOCAL;
    g_assert_cmpint(tcsetattr(fd, TCSANOW, &settings), ==, 0);
    close(fd);
    begin_with(&opened, g_steal_pointer(&device), PATIENT_MS, 0);
    expect_plain(&opened, 0, 111);
    end(&opened, NULL);
}

/* Two masters on one line would move axes by each other's answers. */
static void in_use(void) {
    g_autoptr(VirtualModbus) device = modbus_rig_device(TRUE);
    struct modbus_link link = {.bus = (char *)virtual_modbus_bus(device),
                               .baud = 115200,
                               .parity = 1,
                               .stop_bits = 1,
                               .timeout_ms = TIMEOUT_MS};
    GError *error = NULL;
    int other = modbus_serial_take(link.bus);
    g_assert_cmpint(other, >=, 0);
    struct modbus_line *line = ok(modbus_line_new(&link, ERR));
    g_assert_false(modbus_line_connect(line, g_get_monotonic_time() + 500000, &error));
    g_autofree char *holder = g_strdup_printf("test_modbus_rtu (process %d) uses it", getpid());
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_BUSY, holder);
    close(other);
    g_assert_true(modbus_line_connect(line, g_get_monotonic_time() + 3000000, &error));
    g_assert_cmpint(modbus_serial_take(link.bus), ==, -1);
    modbus_line_free(line);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    VirtualModbus *served = modbus_rig_device(TRUE);
    modbus_rig_conformance(virtual_modbus_bus(served), "modbus-rtu", modbus_rig_fail, served);
    modbus_rig_conformance_watchdog(virtual_modbus_bus(served), "modbus-rtu-register", FALSE,
                                    modbus_rig_fail, served);
    modbus_rig_conformance_watchdog(virtual_modbus_bus(served), "modbus-rtu-pulses", TRUE,
                                    modbus_rig_fail, served);
    g_test_add_func("/modbus/rtu/raw-is-fooled", raw_is_fooled);
    g_test_add("/modbus/rtu/late-is-asked-again", struct opened, NULL, begin, late_is_asked_again,
               end);
    g_test_add_func("/modbus/rtu/late-is-not-the-next", late_is_not_the_next);
    g_test_add_func("/modbus/rtu/held-up-is-asked-again", held_up_is_asked_again);
    g_test_add("/modbus/rtu/always-held-up-is-an-error", struct opened, NULL, begin,
               always_held_up_is_an_error, end);
    g_test_add("/modbus/rtu/very-late-is-disbelieved", struct opened, NULL, begin,
               very_late_is_disbelieved, end);
    g_test_add("/modbus/rtu/damaged-is-repeated", struct opened, NULL, begin_patient,
               damaged_is_repeated, end);
    g_test_add("/modbus/rtu/order", struct opened, NULL, begin_patient, order, end);
    g_test_add("/modbus/rtu/waiting-does-not-count", struct opened, NULL, begin,
               waiting_does_not_count, end);
    g_test_add_func("/modbus/rtu/left-behind", left_behind);
    g_test_add_func("/modbus/rtu/in-use", in_use);
    int result = g_test_run();
    virtual_modbus_free(served);
    return result;
}
