/* Answers of USB devices: a Tic that homes and moves, and a relay board that switches a laser. The
 * functions of usb.h are replaced here. The clock is virtual, and answers arrive when it moves. */
#include "fuzz.h"

#include "conformance/conformance.h"
#include "drivers/device.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "usb/usb.h"

#include <math.h>
#include <string.h>

#define STEPS      24
#define ANSWER_US  1000
#define MAX_FAILED 8 /* answers; then the device is unplugged */

struct UsbDevice {
    UsbLostFunc lost;
    gpointer user;
    GList *waiting; /* of struct answer */
};

struct answer {
    UsbDevice *usb;
    UsbFunc func;
    gpointer user;
    guint8 data[256];
    int n; /* -1: stalled; -2: none in time */
    guint call;
};

static const uint8_t *script;
static size_t left;
static Clock *rig_clock;
static int n_failed;
static UsbDevice *opened; /* NULL: none */

static int next_byte(void) {
    return left > 0 ? (left--, *script++) : -1;
}

/* Most answers have the length that was asked for; without a script left, they are zeros. */
static int take_answer(guint8 *to, guint16 length) {
    const int kind = next_byte();
    if (kind >= 0xf0) {
        n_failed++;
        return kind & 1 ? -1 : -2;
    }
    const int n = kind >= 0xe0 ? MIN(length, kind & 15) : length;
    for (int i = 0; i < n; i++) {
        const int value = next_byte();
        to[i] = value < 0 ? 0 : (guint8)value;
    }
    return n;
}

static void set_error(int n, GError **error) {
    if (n == -1)
        device_error_set(error, DEVICE_ERROR_PROTOCOL, "fuzz", "stalled");
    else
        device_error_set(error, DEVICE_ERROR_TIMEOUT, "fuzz", "no answer");
}

UsbDevice *usb_open(const struct usb_match *match, UsbLostFunc lost, gpointer user,
                    GError **error) {
    if (next_byte() == 0xff) {
        device_error_set(error, DEVICE_ERROR_DISCONNECTED, match->who, "is not there");
        return NULL;
    }
    UsbDevice *usb = g_new0(UsbDevice, 1);
    usb->lost = lost;
    usb->user = user;
    opened = usb;
    if (match->read_serial) {
        g_autofree char *serial = match->read_serial(usb);
        g_assert_true(g_utf8_validate(serial, -1, NULL));
    }
    return usb;
}

static void answer_drop(gpointer data) {
    struct answer *answer = data;
    clock_cancel(rig_clock, &answer->call);
    g_free(answer);
}

void usb_close(UsbDevice *usb) {
    if (!usb)
        return;
    g_list_free_full(usb->waiting, answer_drop);
    g_free(usb);
    opened = NULL;
}

static void on_time(gpointer data) {
    struct answer *answer = data;
    GError *error = NULL;
    UsbDevice *usb = answer->usb;
    answer->call = 0;
    usb->waiting = g_list_remove(usb->waiting, answer);
    if (answer->n < 0)
        set_error(answer->n, &error);
    answer->func(usb, answer->n > 0 ? answer->data : NULL, (gsize)MAX(answer->n, 0), error,
                 answer->user);
    g_clear_error(&error);
    g_free(answer);
    if (opened && !opened->waiting && n_failed > MAX_FAILED) {
        n_failed = 0;
        opened->lost(opened, opened->user);
    }
}

gboolean usb_control(UsbDevice *usb, const struct usb_request *request, guint timeout_ms,
                     UsbFunc func, gpointer user, GError **error) {
    struct answer *answer = g_new0(struct answer, 1);
    const gboolean in = request->type & 0x80;
    *answer = (struct answer){.usb = usb, .func = func, .user = user};
    g_assert_cmpuint(request->length, <=, sizeof answer->data);
    answer->n = take_answer(answer->data, in ? request->length : 0);
    usb->waiting = g_list_append(usb->waiting, answer);
    answer->call = clock_call_in(rig_clock, answer->n == -2 ? (gint64)timeout_ms * 1000 : ANSWER_US,
                                 on_time, answer);
    return TRUE;
}

int usb_control_sync(UsbDevice *usb, const struct usb_request *request, guint8 *answer,
                     GError **error) {
    guint8 data[256];
    g_assert_cmpuint(request->length, <=, sizeof data);
    const int n = take_answer(data, request->type & 0x80 ? request->length : 0);
    if (n < 0) {
        set_error(n, error);
        return -1;
    }
    if (answer)
        memcpy(answer, data, (size_t)n);
    return n;
}

char *usb_path_of(struct libusb_device *device) {
    return g_strdup("1-1");
}

guint8 usb_interface(const UsbDevice *usb) {
    return 0;
}

char *usb_words(const char *what, const char *serial, const char *path) {
    return g_strdup(what);
}

const char *usb_product(const UsbDevice *usb) {
    return "USBRelay4";
}

const char *usb_serial(const UsbDevice *usb) {
    return "";
}

static void set_flag(gpointer data) {
    *(gboolean *)data = TRUE;
}

static void pass(double ms) {
    gboolean over = FALSE;
    clock_call_in(rig_clock, (gint64)(ms * 1000), set_flag, &over);
    while (!over)
        g_main_context_iteration(NULL, TRUE);
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    g_assert_true((event == AXIS_FAULT) == (error != NULL));
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
}

static void drive_axis(Axis *axis) {
    axis_listen(axis, on_axis, NULL);
    for (int step = 0; step < STEPS && left > 0; step++) {
        const int what = next_byte();
        GError *error = NULL;
        gboolean ok = TRUE;
        if (what % 8 == 0)
            ok = axis_is_moving(axis) || axis_home(axis, &error);
        else if (what % 8 == 1)
            ok = !axis_is_homed(axis) || axis_is_moving(axis) || axis_move(axis, what / 8, &error);
        else if (what % 8 == 2)
            ok = axis_stop(axis, &error);
        else if (what % 8 == 3)
            ok = axis_halt(axis, &error);
        else
            pass(what);
        fuzz_check(ok, &error);
        g_assert_true(isfinite(axis_position_deg(axis)));
    }
}

static void drive_laser(Laser *laser) {
    laser_listen(laser, on_laser, NULL);
    for (int step = 0; step < STEPS && left > 0; step++) {
        const int what = next_byte();
        GError *error = NULL;
        if (what % 4 < 2)
            fuzz_check(laser_set(laser, what & 1, &error), &error);
        else
            pass(what);
        laser_is_on(laser);
        laser_safety(laser);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const struct conformance tic = {
        .section = "[axis test]\ndriver = tic-axis\nsteps_per_deg = 100\nmin_deg = 0\n"
                   "max_deg = 38\nspeed_deg_s = 60\naccel_deg_s2 = 1200\npoll_ms = 10\n"};
    static const struct conformance relay = {
        .section = "[laser test]\ndriver = usb-relay-laser\nrelay = 2\n"};
    const struct config_section *section;
    GError *error = NULL;
    script = data;
    left = size;
    n_failed = 0;
    const gboolean is_tic = next_byte() % 2 == 0;
    g_autoptr(Config) config = conformance_config(is_tic ? &tic : &relay, "", &section);
    rig_clock = clock_new_virtual();
    if (is_tic) {
        Axis *axis = axis_open(&tic_axis_driver, section, NULL, rig_clock, &error);
        fuzz_check(axis != NULL, &error);
        if (axis) {
            drive_axis(axis);
            axis_close(axis);
        }
    } else {
        Laser *laser = laser_open(&usb_relay_laser_driver, section, NULL, rig_clock, &error);
        fuzz_check(laser != NULL, &error);
        if (laser) {
            drive_laser(laser);
            laser_close(laser);
        }
    }
    while (g_main_context_iteration(NULL, FALSE))
        ;
    g_clear_pointer(&rig_clock, clock_unref);
    return 0;
}
