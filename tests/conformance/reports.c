#include "reports.h"

#include <string.h>

#define MAX_LAMPS 1024

/* The linker replaces NAME by __wrap_NAME in the drivers, and __real_NAME by NAME here. */
#define WRAPPED(name)                                                                              \
    typeof(name) name##_wrapped __asm__("__wrap_" #name);                                          \
    typeof(name) name##_real __asm__("__real_" #name)
WRAPPED(axis_report);
WRAPPED(lamps_report);
WRAPPED(laser_report);
WRAPPED(camera_report_exposed);
WRAPPED(camera_report_frame);
WRAPPED(camera_report_fault);
WRAPPED(interlock_report);
WRAPPED(interlock_report_lost);

/* The call of the driver that is under way, or NULL. */
static const char *in_call;

/* Calls a function of the driver and notes its name meanwhile. */
#define CALL(ret, name, ...)                                                                       \
    do {                                                                                           \
        const char *outer = in_call;                                                               \
        in_call = #name "()";                                                                      \
        ret = from->name(__VA_ARGS__);                                                             \
        in_call = outer;                                                                           \
    } while (FALSE)

/* Takes a report. due is the number of commands that still wait for it. */
static void take(const struct device *device, const char *report, int *due) {
    if (in_call)
        g_error("%s: the driver reported from within %s; report from the main loop", device->who,
                in_call);
    if (*due < 1)
        g_error("%s: the driver called %s, but no command waits for it; report each command "
                "exactly once",
                device->who, report);
    --*due;
}

static struct {
    const struct lamps_driver *from;
    struct lamps_driver driver;
    int due[MAX_LAMPS + 1][2]; /* of lamp index: due[index + 1][on] */
} lamps;

static gboolean lamps_open_counted(LampBank *bank, GError **error) {
    memset(lamps.due, 0, sizeof lamps.due);
    return lamps.from->open(bank, error);
}

static gboolean lamps_set_counted(LampBank *bank, int index, gboolean on, GError **error) {
    const struct lamps_driver *from = lamps.from;
    gboolean accepted;
    CALL(accepted, set, bank, index, on, error);
    lamps.due[index + 1][on] += accepted;
    return accepted;
}

const struct lamps_driver *reports_of_lamps(const struct lamps_driver *driver) {
    if (driver == &lamps.driver)
        return driver;
    lamps.from = driver;
    lamps.driver = *driver;
    lamps.driver.open = lamps_open_counted;
    lamps.driver.set = lamps_set_counted;
    return &lamps.driver;
}

void lamps_report_wrapped(LampBank *bank, int index, gboolean on, GError *error) {
    if (bank->driver == &lamps.driver) {
        g_autofree char *report = g_strdup_printf("lamps_report(%d, %s)", index, on ? "on" : "off");
        g_assert_cmpint(index, >=, -1);
        g_assert_cmpint(index, <, bank->n);
        take(&bank->device, report, &lamps.due[index + 1][on != FALSE]);
    }
    lamps_report_real(bank, index, on, error);
}

static struct {
    const struct laser_driver *from;
    struct laser_driver driver;
    int due[2]; /* of off and on */
} laser;

static gboolean laser_open_counted(Laser *device, GError **error) {
    memset(laser.due, 0, sizeof laser.due);
    return laser.from->open(device, error);
}

static gboolean laser_set_counted(Laser *device, gboolean on, GError **error) {
    const struct laser_driver *from = laser.from;
    gboolean accepted;
    CALL(accepted, set, device, on, error);
    laser.due[on] += accepted;
    return accepted;
}

const struct laser_driver *reports_of_laser(const struct laser_driver *driver) {
    if (driver == &laser.driver)
        return driver;
    laser.from = driver;
    laser.driver = *driver;
    laser.driver.open = laser_open_counted;
    laser.driver.set = laser_set_counted;
    return &laser.driver;
}

void laser_report_wrapped(Laser *device, gboolean on, GError *error) {
    if (device->driver == &laser.driver)
        take(&device->device, on ? "laser_report(on)" : "laser_report(off)",
             &laser.due[on != FALSE]);
    laser_report_real(device, on, error);
}

static struct {
    const struct axis_driver *from;
    struct axis_driver driver;
    int motions, stops; /* that wait for a report */
} axis;

static gboolean axis_open_counted(Axis *device, GError **error) {
    axis.motions = axis.stops = 0;
    return axis.from->open(device, error);
}

static gboolean axis_home_counted(Axis *device, GError **error) {
    const struct axis_driver *from = axis.from;
    gboolean accepted;
    CALL(accepted, home, device, error);
    axis.motions += accepted;
    return accepted;
}

static gboolean axis_move_counted(Axis *device, double target_deg, GError **error) {
    const struct axis_driver *from = axis.from;
    gboolean accepted;
    CALL(accepted, move, device, target_deg, error);
    axis.motions += accepted;
    return accepted;
}

static gboolean axis_turn_counted(Axis *device, double target_deg, double speed_deg_s,
                                  GError **error) {
    const struct axis_driver *from = axis.from;
    gboolean accepted;
    CALL(accepted, turn, device, target_deg, speed_deg_s, error);
    axis.motions += accepted;
    return accepted;
}

static gboolean axis_stop_counted(Axis *device, GError **error) {
    const struct axis_driver *from = axis.from;
    gboolean accepted;
    CALL(accepted, stop, device, error);
    axis.stops += accepted;
    return accepted;
}

const struct axis_driver *reports_of_axis(const struct axis_driver *driver) {
    if (driver == &axis.driver)
        return driver;
    axis.from = driver;
    axis.driver = *driver;
    axis.driver.open = axis_open_counted;
    axis.driver.home = axis_home_counted;
    axis.driver.move = axis_move_counted;
    axis.driver.turn = driver->turn ? axis_turn_counted : NULL;
    axis.driver.stop = axis_stop_counted;
    return &axis.driver;
}

/* One AXIS_STOPPED or AXIS_FAULT ends both a stop and the motion that it stopped. A motion that
 * arrives while a stop is under way may be reported before the stop, or by the stop. An AXIS_FAULT
 * of an axis that stands needs no command. */
void axis_report_wrapped(Axis *device, enum axis_event event, GError *error) {
    static const char *const names[] = {
        [AXIS_ARRIVED] = "axis_report(AXIS_ARRIVED)", [AXIS_HOMED] = "axis_report(AXIS_HOMED)",
        [AXIS_STOPPED] = "axis_report(AXIS_STOPPED)", [AXIS_PASSING] = "axis_report(AXIS_PASSING)",
        [AXIS_FAULT] = "axis_report(AXIS_FAULT)",
    };
    if (device->driver == &axis.driver) {
        const gboolean ends_stop = event == AXIS_STOPPED || event == AXIS_FAULT;
        int due = axis.motions + (ends_stop ? axis.stops : 0) + (event == AXIS_FAULT);
        take(&device->device, names[event], &due);
        axis.motions = 0;
        axis.stops = ends_stop ? MAX(0, axis.stops - 1) : axis.stops;
    }
    axis_report_real(device, event, error);
}

static struct {
    const struct camera_driver *from;
    struct camera_driver driver;
    int frames, exposed; /* reports that are due */
    gboolean disarmed;   /* reports of a trigger before disarm() may still come */
} camera;

static gboolean camera_open_counted(Camera *device, GError **error) {
    camera.frames = camera.exposed = 0;
    camera.disarmed = FALSE;
    return camera.from->open(device, error);
}

static void camera_disarm_counted(Camera *device) {
    camera.disarmed |= camera.frames > 0;
    camera.from->disarm(device);
}

static gboolean camera_trigger_counted(Camera *device, guint64 shot, GError **error) {
    const struct camera_driver *from = camera.from;
    gboolean accepted;
    CALL(accepted, trigger, device, shot, error);
    camera.frames = camera.disarmed ? camera.frames + accepted : accepted;
    camera.exposed = camera.disarmed ? camera.exposed + accepted : accepted;
    return accepted;
}

const struct camera_driver *reports_of_camera(const struct camera_driver *driver) {
    if (driver == &camera.driver)
        return driver;
    camera.from = driver;
    camera.driver = *driver;
    camera.driver.open = camera_open_counted;
    camera.driver.disarm = camera_disarm_counted;
    camera.driver.trigger = camera_trigger_counted;
    return &camera.driver;
}

void camera_report_exposed_wrapped(Camera *device) {
    if (device->driver == &camera.driver)
        take(&device->device, "camera_report_exposed()", &camera.exposed);
    camera_report_exposed_real(device);
}

void camera_report_frame_wrapped(Camera *device, Frame *frame) {
    if (device->driver == &camera.driver)
        take(&device->device, "camera_report_frame()", &camera.frames);
    camera_report_frame_real(device, frame);
}

void camera_report_fault_wrapped(Camera *device, GError *error) {
    if (device->driver == &camera.driver)
        take(&device->device, "camera_report_fault()", &camera.frames);
    camera_report_fault_real(device, error);
}

static struct {
    const struct interlock_driver *from;
    struct interlock_driver driver;
    int n;
} interlock;

static gboolean interlock_open_counted(Interlock *device, GError **error) {
    interlock.n = 0;
    return interlock.from->open(device, error);
}

const struct interlock_driver *reports_of_interlock(const struct interlock_driver *driver,
                                                    const int **ret_n) {
    interlock.from = driver;
    interlock.driver = *driver;
    interlock.driver.open = interlock_open_counted;
    *ret_n = &interlock.n;
    return &interlock.driver;
}

void interlock_report_wrapped(Interlock *device, gboolean closed) {
    interlock.n += device->driver == &interlock.driver;
    interlock_report_real(device, closed);
}

void interlock_report_lost_wrapped(Interlock *device) {
    interlock.n += device->driver == &interlock.driver;
    interlock_report_lost_real(device);
}
