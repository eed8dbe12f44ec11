/* test: uses every device of a rig once and reports the result. */
#include <math.h>
#include <string.h>

#include "hand_link.h"
#include "hands.h"
#include "picture_report.h"
#include "rig/devices.h"

#define EXPOSURE_US 10000
#define MOVE_DEG    5
/* A camera sees a lamp if the lamp raises the mean of its picture by LAMP_PART of the range. It
 * sees a laser if the laser raises the brightest pixel by LASER_PART. */
#define LAMP_PART  0.0005
#define LASER_PART 0.004

static gint64 exposure_us;

static const GOptionEntry entries[] = {
    {"exposure-us", 'e', 0, G_OPTION_ARG_INT64, &exposure_us, "Exposure time in µs (10000)", "US"},
    HAND_RIG_ENTRY,
    {NULL},
};

struct trial {
    Link *link;
    Record *to;
    struct rig rig;
    gboolean dark_known[RIG_MAX_CAMERAS];
    struct picture_report dark[RIG_MAX_CAMERAS];
    int n, n_good;
};

/* Reports the result of a device. Takes ownership of what. */
static void tell(struct trial *trial, const char *class_name, const char *name, gboolean good,
                 char *what) {
    record_begin(trial->to, NULL);
    record_say(trial->to, "%-4s %-10s{class} %-16s{name} ", good ? "ok" : "FAIL", class_name, name);
    record_boolean(trial->to, "good", good);
    record_say(trial->to, "%s{said}\n", what);
    record_end(trial->to);
    trial->n++;
    trial->n_good += good;
    g_free(what);
}

static void fail(struct trial *trial, const char *class_name, const char *name, GError *error) {
    g_dbus_error_strip_remote_error(error);
    tell(trial, class_name, name, FALSE, g_strdup(error->message));
}

/* Homes an axis, moves it a little, and moves it back. */
static void try_axis(struct trial *trial, const char *name) {
    g_autoptr(GError) error = NULL;
    double home, there, back;
    const gint64 begun_us = g_get_monotonic_time();
    if (!hand_home(trial->link, name, &home, &error)) {
        fail(trial, "axis", name, error);
        return;
    }
    gboolean good = hand_move(trial->link, name, home + MOVE_DEG, &there, &error);
    if (g_error_matches(error, DEVICE_ERROR,
                        DEVICE_ERROR_RANGE)) { /* the target is beyond a limit of the axis */
        g_clear_error(&error);
        good = hand_move(trial->link, name, home - MOVE_DEG, &there, &error);
    }
    if (!good || !hand_move(trial->link, name, home, &back, &error)) {
        fail(trial, "axis", name, error);
        return;
    }
    tell(trial, "axis", name, TRUE,
         g_strdup_printf("homed at %g°, moved to %g° and back to %g° in %.1f s", home, there, back,
                         (double)(g_get_monotonic_time() - begun_us) * 1e-6));
}

static void try_camera(struct trial *trial, int i) {
    g_autoptr(GError) error = NULL;
    char name[RIG_NAME];
    rig_stop_device(trial->rig.cameras[i].name, trial->rig.cameras[i].on_arm, name);
    g_autoptr(Frame) frame = hand_snap(trial->link, name, exposure_us, 0, &error);
    if (!frame) {
        fail(trial, "camera", name, error);
        return;
    }
    trial->dark_known[i] = TRUE;
    trial->dark[i] = picture_report(frame);
    tell(trial, "camera", name, TRUE,
         g_strdup_printf("%d × %d pixels of %d bits; with all lamps off %.0f DN on average",
                         frame->width, frame->height, frame->bits, trial->dark[i].mean_dn));
}

/* Switches a lamp or laser on and off, and checks whether any camera sees it. */
static void try_light(struct trial *trial, gboolean laser, const char *name) {
    const char *class_name = laser ? "laser" : "lamp";
    g_autoptr(GError) error = NULL;
    int asked = 0, saw = 0;
    double most_dn = 0;
    if (!hand_light(trial->link, laser, name, TRUE, &error)) {
        fail(trial, class_name, name, error);
        return;
    }
    for (int i = 0; i < trial->rig.n_cameras && !error; i++) {
        if (!trial->dark_known[i])
            continue;
        char camera[RIG_NAME];
        rig_stop_device(trial->rig.cameras[i].name, trial->rig.cameras[i].on_arm, camera);
        g_autoptr(Frame) frame = hand_snap(trial->link, camera, exposure_us, 0, &error);
        if (!frame)
            break;
        const struct picture_report lit = picture_report(frame), *dark = &trial->dark[i];
        const double rise_dn = laser ? lit.max_dn - dark->max_dn : lit.mean_dn - dark->mean_dn;
        asked++;
        saw += rise_dn > (laser ? LASER_PART : LAMP_PART) * ((1 << frame->bits) - 1);
        most_dn = MAX(most_dn, rise_dn);
    }
    if (!hand_light(trial->link, laser, name, FALSE, error ? NULL : &error) || error) {
        fail(trial, class_name, name, error);
        return;
    }
    tell(trial, class_name, name, saw > 0 || asked == 0,
         asked == 0 ? g_strdup("switched on and off; there was no camera to see it")
         : saw > 0
             ? g_strdup_printf("seen by %d of %d cameras, by up to %.0f DN", saw, asked, most_dn)
             : g_strdup_printf("switched on and off, but none of %d cameras saw it: check %s",
                               asked,
                               laser ? "its power, and where its line falls"
                                     : "the lamp, its fuse and its relay"));
}

static void try_interlock(struct trial *trial, const char *name, const char *health) {
    const gboolean closed = strcmp(health, "closed") == 0;
    tell(trial, "interlock", name, closed,
         g_strdup(closed ? "closed" : "open: lasers and axes are refused; close it"));
}

/* Tries interlocks first, because lasers and axes depend on them. Then tries axes, cameras, lamps
 * and lasers. */
static void try_all(struct trial *trial) {
    static const char *const classes[] = {"interlock", "axis"};
    g_autoptr(GVariant) devices = bus_rig1_dup_devices(link_rig(trial->link));
    const char *class_name, *name, *driver, *health;
    for (gsize k = 0; devices && k < G_N_ELEMENTS(classes); k++) {
        GVariantIter iter;
        g_variant_iter_init(&iter, devices);
        while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health)) {
            if (strcmp(class_name, classes[k]) != 0)
                continue;
            if (k == 0)
                try_interlock(trial, name, health);
            else
                try_axis(trial, name);
        }
    }
    for (int i = 0; i < trial->rig.n_cameras; i++)
        if (rig_camera_unit(&trial->rig, i) == i)
            try_camera(trial, i);
    for (int i = 0; i < trial->rig.n_lamps; i++) {
        char lamp[RIG_NAME];
        rig_stop_device(trial->rig.lamps[i].name, trial->rig.lamps[i].on_probe, lamp);
        if (rig_lamp_unit(&trial->rig, i) == i)
            try_light(trial, FALSE, lamp);
    }
    if (!devices)
        return;
    GVariantIter iter;
    /* Further places of a laser unit are not separate devices. */
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        if (strcmp(class_name, "laser") == 0)
            try_light(trial, TRUE, name);
}

static int run_test(const struct call *call, GError **error) {
    struct trial trial = {.to = call->record};
    if (exposure_us == 0)
        exposure_us = EXPOSURE_US;
    if (exposure_us < 0)
        return cli_usage(call->command,
                         "--exposure-us=%" G_GINT64_FORMAT ": give a number of µs above 0",
                         exposure_us);
    g_autoptr(Link) link = trial.link = hand_link(error);
    if (!link || !devices_read_geometry(bus_rig1_get_rig_path(link_rig(link)), &trial.rig, error))
        return CLI_FAILED;
    const char *session = bus_rig1_get_session(link_rig(link));
    const char *state = bus_rig1_get_state(link_rig(link));
    if (session && *session && strcmp(state, "done") != 0 && strcmp(state, "aborted") != 0) {
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_BUSY,
            "the session %s is being captured (state: %s): test the rig when the capture has ended",
            session, state);
        return CLI_FAILED;
    }
    record_begin_list(trial.to, "devices");
    try_all(&trial);
    record_end(trial.to);
    record_int(trial.to, "tested", trial.n);
    record_say(trial.to, "%d{good} of %d are as they should be\n", trial.n_good, trial.n);
    return trial.n_good == trial.n ? CLI_DONE : CLI_FAILED;
}

const struct command hands_test = {
    .name = "test",
    .arguments = "",
    .examples = "  mesorig test\n"
                "  mesorig test --rig etc/demo/rig.conf\n",
    .help = "Test every device. Reads the interlocks, moves each axis, takes a picture with each "
            "camera, and looks for the light of each lamp and laser. Fails unless all pass.",
    .options = entries,
    .daemon = TRUE,
    .run = run_test};
