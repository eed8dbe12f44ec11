/* test: uses every device of a rig once and reports the result. */
#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "hand_link.h"
#include "hands.h"
#include "rig/devices.h"
#include "test_report.h"

#define EXPOSURE_US 10000
#define MOVE_DEG    5
/* A camera counts as seeing a lamp if the lamp raises the mean of its picture by LAMP_PART of the
 * range. It counts as seeing a laser if the laser raises the brightest pixel by LASER_PART of the
 * range. */
#define LAMP_PART  0.0005
#define LASER_PART 0.004

static gint64 exposure_us;
static char *record_option, *report_option;

static const GOptionEntry entries[] = {
    {"exposure-us", 'e', 0, G_OPTION_ARG_INT64, &exposure_us, "Exposure time in µs (10000)", "US"},
    {"report", 0, 0, G_OPTION_ARG_FILENAME, &report_option,
     "Write a page with pictures, figures and the recording, to mail", "FILE.html"},
    {"record", 0, 0, G_OPTION_ARG_FILENAME, &record_option,
     "Write what the devices said on their buses; opens the rig again", "FILE.rec"},
    HAND_RIG_ENTRY,
    {NULL},
};

struct trial {
    Link *link;
    Record *to;
    struct rig rig;
    struct test_report report;
    gboolean dark_known[RIG_MAX_CAMERAS];
    struct picture_values dark[RIG_MAX_CAMERAS];
    /* rise of the mean, in DN, in the picture that the report shows of the camera */
    double most_dn[RIG_MAX_CAMERAS];
    int n, n_good;
};

static double since(gint64 begun_us) {
    return (double)(g_get_monotonic_time() - begun_us) * 1e-6;
}

static struct test_result *begin(struct trial *trial, const char *class_name, const char *name,
                                 const char *driver) {
    struct test_result *result = test_report_add(&trial->report, class_name, name, driver);
    result->seconds = (double)g_get_monotonic_time() * 1e-6; /* until tell() */
    return result;
}

/* Finishes the result of a device with the sentence `what`, of which it takes ownership. */
static void tell(struct trial *trial, struct test_result *result, gboolean good, char *what) {
    result->seconds = (double)g_get_monotonic_time() * 1e-6 - result->seconds;
    result->good = good;
    result->said = what;
    record_begin(trial->to, NULL);
    record_say(trial->to, "%-4s %-10s{class} %-16s{name} ", good ? "ok" : "FAIL",
               result->class_name, result->name);
    record_boolean(trial->to, "good", good);
    record_say(trial->to, "%s{said}\n", what);
    record_double(trial->to, "seconds", result->seconds);
    record_end(trial->to);
    trial->n++;
    trial->n_good += good;
}

static void fail(struct trial *trial, struct test_result *result, GError *error) {
    g_dbus_error_strip_remote_error(error);
    tell(trial, result, FALSE, g_strdup(error->message));
}

static void add_move(struct test_result *result, double target_deg, double reached_deg,
                     gint64 begun_us, gboolean homes) {
    const struct test_move move = {target_deg, reached_deg, since(begun_us), homes};
    g_array_append_val(result->moves, move);
}

/* Homes an axis, moves it a little, and moves it back. */
static void try_axis(struct trial *trial, const char *name, const char *driver) {
    struct test_result *result = begin(trial, "axis", name, driver);
    g_autoptr(GError) error = NULL;
    double home, there, back, target;
    const gint64 begun_us = g_get_monotonic_time();
    if (!hand_home(trial->link, name, &home, &error)) {
        fail(trial, result, error);
        return;
    }
    add_move(result, home, home, begun_us, TRUE);
    gint64 moved_us = g_get_monotonic_time();
    target = home + MOVE_DEG;
    gboolean good = hand_move(trial->link, name, target, &there, &error);
    if (g_error_matches(error, DEVICE_ERROR,
                        DEVICE_ERROR_RANGE)) { /* the target is beyond a limit of the axis */
        g_clear_error(&error);
        target = home - MOVE_DEG;
        good = hand_move(trial->link, name, target, &there, &error);
    }
    if (good)
        add_move(result, target, there, moved_us, FALSE);
    moved_us = g_get_monotonic_time();
    if (!good || !hand_move(trial->link, name, home, &back, &error)) {
        fail(trial, result, error);
        return;
    }
    add_move(result, home, back, moved_us, FALSE);
    tell(trial, result, TRUE,
         g_strdup_printf("homed at %g°, moved to %g° and back to %g° in %.1f s", home, there, back,
                         since(begun_us)));
}

static void camera_name(const struct trial *trial, int i, char name[RIG_NAME]) {
    rig_stop_device(trial->rig.cameras[i].name, trial->rig.cameras[i].on_arm, name);
}

static void try_camera(struct trial *trial, int i, const char *driver) {
    g_autoptr(GError) error = NULL;
    char name[RIG_NAME];
    camera_name(trial, i, name);
    struct test_result *result = begin(trial, "camera", name, driver);
    g_autoptr(Frame) frame = hand_snap(trial->link, name, exposure_us, 0, &error);
    g_autoptr(Frame) second =
        frame && report_option ? hand_snap(trial->link, name, exposure_us, 0, &error) : NULL;
    if (!frame || error) {
        fail(trial, result, error);
        return;
    }
    trial->dark_known[i] = TRUE;
    trial->dark[i] = picture_values(frame);
    struct test_picture *picture = test_report_add_picture(&trial->report, name, NULL, frame);
    if (second)
        picture->noise_dn = test_noise_dn(frame, second);
    tell(trial, result, TRUE,
         g_strdup_printf("%d × %d pixels of %d bits; with all lamps off %.0f DN on average",
                         frame->width, frame->height, frame->bits, trial->dark[i].mean_dn));
}

/* Takes a picture with each camera that has a dark picture, while a light is on. For each camera,
 * the report keeps the picture under the lamp that makes it brightest. If a picture fails, the
 * remaining cameras take none. */
static void look(struct trial *trial, gboolean laser, struct test_result *result, int *ret_asked,
                 int *ret_saw, GError **error) {
    for (int i = 0; i < trial->rig.n_cameras; i++) {
        if (!trial->dark_known[i])
            continue;
        char camera[RIG_NAME];
        camera_name(trial, i, camera);
        g_autoptr(Frame) frame = hand_snap(trial->link, camera, exposure_us, 0, error);
        if (!frame)
            return;
        const struct picture_values lit = picture_values(frame), *dark = &trial->dark[i];
        const double rise_dn = laser ? lit.max_dn - dark->max_dn : lit.mean_dn - dark->mean_dn;
        ++*ret_asked;
        *ret_saw += rise_dn > (laser ? LASER_PART : LAMP_PART) * ((1 << frame->bits) - 1);
        result->rise_dn = isnan(result->rise_dn) ? rise_dn : MAX(result->rise_dn, rise_dn);
        if (!laser && rise_dn > trial->most_dn[i]) {
            trial->most_dn[i] = rise_dn;
            test_report_add_picture(&trial->report, camera, result->name, frame);
        }
    }
}

/* Returns in words what it means that a driver has confirmed a command. */
static const char *confirmed_by(const char *driver) {
    const struct driver_info *info;
    for (gsize i = 0; (info = devices_driver(i)); i++)
        if (strcmp(info->name, driver) == 0 && info->confirmed)
            return info->confirmed;
    return "read back";
}

/* Switches a lamp or laser on and off, and checks whether any camera sees it. */
static void try_light(struct trial *trial, gboolean laser, const char *name, const char *driver) {
    struct test_result *result = begin(trial, laser ? "laser" : "lamp", name, driver);
    g_autoptr(GError) error = NULL;
    int asked = 0, saw = 0;
    gint64 begun_us = g_get_monotonic_time();
    result->confirmed = confirmed_by(driver);
    if (!hand_light(trial->link, laser, name, TRUE, &error)) {
        fail(trial, result, error);
        return;
    }
    result->on_s = since(begun_us);
    look(trial, laser, result, &asked, &saw, &error);
    begun_us = g_get_monotonic_time();
    if (!hand_light(trial->link, laser, name, FALSE, error ? NULL : &error) || error) {
        fail(trial, result, error);
        return;
    }
    result->off_s = since(begun_us);
    tell(trial, result, saw > 0 || asked == 0,
         asked == 0 ? g_strdup("switched on and off; there was no camera to see it")
         : saw > 0  ? g_strdup_printf("seen by %d of %d cameras, by up to %.0f DN", saw, asked,
                                      MAX(result->rise_dn, 0))
                   : g_strdup_printf("switched on and off, but none of %d cameras saw it: check %s",
                                     asked,
                                     laser ? "its power, and where its line falls"
                                           : "the lamp, its fuse and its relay"));
}

static void try_interlock(struct trial *trial, const char *name, const char *driver,
                          const char *health) {
    const gboolean closed = strcmp(health, "closed") == 0;
    tell(trial, begin(trial, "interlock", name, driver), closed,
         g_strdup(closed ? "closed" : "open: lasers and axes are refused; close it"));
}

/* Returns the driver of the device with a class and a name, or "" if there is none. For a lamp,
 * name is NULL, because a lamp is part of a bank that has another name. The result is then the
 * driver of all banks, or "" if the banks have different drivers. */
static const char *driver_of(GVariant *devices, const char *class_name, const char *name) {
    const char *found = "", *of_class, *of_name, *driver, *health;
    GVariantIter iter;
    if (!devices)
        return "";
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &of_class, &of_name, &driver, &health)) {
        if (strcmp(of_class, class_name) != 0 || (name && strcmp(of_name, name) != 0))
            continue;
        if (*found && strcmp(found, driver) != 0)
            return "";
        found = driver;
    }
    return found;
}

/* Tests all devices. Interlocks come first, because lasers and axes depend on them; then axes,
 * cameras, lamps and lasers. */
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
                try_interlock(trial, name, driver, health);
            else
                try_axis(trial, name, driver);
        }
    }
    for (int i = 0; i < trial->rig.n_cameras; i++) {
        char camera[RIG_NAME];
        camera_name(trial, i, camera);
        if (rig_camera_unit(&trial->rig, i) == i)
            try_camera(trial, i, driver_of(devices, "camera", camera));
    }
    for (int i = 0; i < trial->rig.n_lamps; i++) {
        char lamp[RIG_NAME];
        rig_stop_device(trial->rig.lamps[i].name, trial->rig.lamps[i].on_probe, lamp);
        if (rig_lamp_unit(&trial->rig, i) == i)
            try_light(trial, FALSE, lamp, driver_of(devices, "lamps", NULL));
    }
    if (!devices)
        return;
    GVariantIter iter;
    /* Lasers come from the list of devices and not from the rig file, because there one laser may
     * have several sections, one for each place. */
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        if (strcmp(class_name, "laser") == 0)
            try_light(trial, TRUE, name, driver);
}

static gboolean need_idle(Link *link, GError **error) {
    const char *session = bus_rig1_get_session(link_rig(link));
    const char *state = bus_rig1_get_state(link_rig(link));
    if (!session || !*session || strcmp(state, "done") == 0 || strcmp(state, "aborted") == 0)
        return TRUE;
    g_set_error(
        error, G_IO_ERROR, G_IO_ERROR_BUSY,
        "the session %s is being captured (state: %s): test the rig when the capture has ended",
        session, state);
    return FALSE;
}

/* Opens the rig, with a recording if `records` is TRUE. Returns FALSE with an error on failure,
 * with one exception. In a recording, a device that cannot be opened is a result: the function
 * returns TRUE and sets *ret_why to the reason, which the recording and the report contain. */
static gboolean open_rig(struct trial *trial, const char *rig, gboolean records, gboolean *was_open,
                         GError **ret_why, GError **error) {
    if (!need_idle(trial->link, error) || !devices_read_geometry(rig, &trial->rig, error))
        return FALSE;
    trial->report.rig = g_strdup(trial->rig.id);
    if (!records)
        return hand_open(trial->link, rig, error);
    if (hand_begin_recording(trial->link, rig, was_open, ret_why))
        return TRUE;
    g_dbus_error_strip_remote_error(*ret_why);
    if ((*ret_why)->domain == DEVICE_ERROR)
        return TRUE;
    g_propagate_error(error, g_steal_pointer(ret_why));
    return FALSE;
}

static gboolean write_text(OutputFile *to, const char *text, GError **error) {
    return !to || output_file_put(to, text, strlen(text), error);
}

/* Tests the rig, and writes the recording and the report (page). Each of the two files may be
 * NULL. */
static gboolean test_rig(struct trial *trial, OutputFile *recording, OutputFile *page,
                         GError **error) {
    g_autofree char *rig = NULL;
    g_autoptr(GError) why = NULL;
    const gboolean records = recording || page;
    gboolean was_open = FALSE;
    g_autoptr(Link) link = trial->link = hand_find(&rig, error);
    if (!link || !open_rig(trial, rig, records, &was_open, &why, error))
        return FALSE;
    record_begin_list(trial->to, "devices");
    if (!why)
        try_all(trial);
    record_end(trial->to);
    if (records &&
        !(trial->report.recording = hand_end_recording(link, rig, was_open && !why, error)))
        return FALSE;
    if (records)
        test_report_hide_places(&trial->report, rig);
    trial->report.failed = why != NULL;
    g_autofree char *html = page ? test_report_page(&trial->report) : NULL;
    if (!write_text(recording, trial->report.recording, error) || !write_text(page, html, error))
        return FALSE;
    if (why) {
        g_propagate_error(error, g_steal_pointer(&why));
        return FALSE;
    }
    return TRUE;
}

static int run_test(const struct call *call, GError **error) {
    struct trial trial = {.to = call->record};
    if (exposure_us == 0)
        exposure_us = EXPOSURE_US;
    if (exposure_us < 0)
        return cli_usage(call->command,
                         "--exposure-us=%" G_GINT64_FORMAT ": give a number of µs above 0",
                         exposure_us);
    g_autoptr(OutputFile) recording = NULL, page = NULL;
    if ((record_option && !(recording = cli_output(record_option, "recording", error))) ||
        (report_option && !(page = cli_output(report_option, "test", error))))
        return CLI_FAILED;
    test_report_init(&trial.report);
    const gboolean tested = test_rig(&trial, recording, page, error);
    test_report_clear(&trial.report);
    if (!tested)
        return CLI_FAILED;
    record_int(trial.to, "tested", trial.n);
    record_say(trial.to, "%d{good} of %d are as they should be\n", trial.n_good, trial.n);
    if (recording) {
        record_say(trial.to, "%s{recording}: read it, then send it\n", record_option);
        cli_tell_output(trial.to, recording);
    }
    if (page) {
        record_say(trial.to, "%s{report}: open it in a browser\n", report_option);
        cli_tell_output(trial.to, page);
    }
    return trial.n_good == trial.n ? CLI_DONE : CLI_FAILED;
}

const struct command hands_test = {
    .name = "test",
    .arguments = "",
    .examples = "  mesorig test\n"
                "  mesorig test --rig bench.conf --report bench.html\n",
    .help = "Test every device. Reads the interlocks, moves each axis, takes a picture with each "
            "camera, and looks for the light of each lamp and laser. Fails unless all pass.",
    .options = entries,
    .daemon = TRUE,
    .writes = TRUE,
    .run = run_test};
