/* Mistakes that the conformance suites must notice: simulated drivers that report a command twice,
 * or from within the call, although their devices do what they should. */
#include "lib/simulated.h"
#include "lib/test.h"

static World *built_once;

#define SUBPROCESS "twice/subprocess" /* GLib runs these tests only by their paths */

/* A further report of a command, a little later. */
struct again {
    gpointer device;
    int index;
    gboolean on;
};

static void again(gpointer device, int index, gboolean on, void (*report)(gpointer)) {
    struct again *what = g_new(struct again, 1);
    *what = (struct again){device, index, on};
    clock_call_in(((struct device *)device)->clock, 1000, report, what);
}

static struct lamps_driver twice_lamps, inside_lamps;
static struct laser_driver twice_laser;
static struct axis_driver twice_axis;
static struct camera_driver twice_camera;

static void report_lamp(gpointer data) {
    g_autofree struct again *what = data;
    lamps_report(what->device, what->index, what->on, NULL);
}

static gboolean set_twice(LampBank *of, int index, gboolean on, GError **error) {
    again(of, index, on, report_lamp);
    return sim_lamps_driver.set(of, index, on, error);
}

static gboolean set_inside(LampBank *of, int index, gboolean on, GError **error) {
    lamps_report(of, index, on, NULL);
    return TRUE;
}

static void report_laser(gpointer data) {
    g_autofree struct again *what = data;
    laser_report(what->device, what->on, NULL);
}

static gboolean set_laser_twice(Laser *of, gboolean on, GError **error) {
    again(of, 0, on, report_laser);
    return sim_laser_driver.set(of, on, error);
}

static void report_stopped(gpointer data) {
    g_autofree struct again *what = data;
    axis_report(what->device, AXIS_STOPPED, NULL);
}

static gboolean stop_twice(Axis *axis, GError **error) {
    again(axis, 0, FALSE, report_stopped);
    return sim_axis_driver.stop(axis, error);
}

static void report_exposed(gpointer data) {
    g_autofree struct again *what = data;
    camera_report_exposed(what->device);
}

static gboolean trigger_twice(Camera *of, guint64 shot, GError **error) {
    again(of, 0, FALSE, report_exposed);
    return sim_camera_driver.trigger(of, shot, error);
}

static void expect(const char *path, const char *words) {
    g_test_trap_subprocess(path, 0, G_TEST_SUBPROCESS_DEFAULT);
    g_test_trap_assert_failed();
    g_test_trap_assert_stderr(words);
}

TEST(twice) {
    expect("/conformance/lamps/" SUBPROCESS "/one-by-one", "*lamps_report(0, on), but no command*");
    expect("/conformance/laser/" SUBPROCESS "/switches", "*laser_report(on), but no command*");
    expect("/conformance/axis/" SUBPROCESS "/stops", "*axis_report(AXIS_STOPPED), but no command*");
    expect("/conformance/camera/" SUBPROCESS "/frames",
           "*camera_report_exposed(), but no command*");
}

TEST(inside) {
    expect("/conformance/lamps/inside/subprocess/one-by-one", "*reported from within set()*");
}

BEFORE_TESTS {
    static struct conformance lamps, inside, with_laser, with_axis, with_camera;
    built_once = world_get(WORLD, NULL);
    twice_lamps = inside_lamps = sim_lamps_driver;
    twice_lamps.set = set_twice;
    inside_lamps.set = set_inside;
    twice_laser = sim_laser_driver;
    twice_laser.set = set_laser_twice;
    twice_axis = sim_axis_driver;
    twice_axis.stop = stop_twice;
    twice_camera = sim_camera_driver;
    twice_camera.trigger = trigger_twice;
    lamps = inside = bank;
    with_laser = laser;
    with_axis = turntable;
    with_camera = camera;
    lamps.name = with_laser.name = with_axis.name = with_camera.name = SUBPROCESS;
    inside.name = "inside/subprocess";
    conformance_lamps(&twice_lamps, &lamps);
    conformance_lamps(&inside_lamps, &inside);
    conformance_laser(&twice_laser, &with_laser);
    conformance_axis(&twice_axis, &with_axis);
    conformance_camera(&twice_camera, &with_camera);
}

AFTER_TESTS {
    g_clear_pointer(&built_once, world_unref);
}
