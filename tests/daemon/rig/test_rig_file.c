#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "plan/plan.h"
#include "rig/devices.h"

#include <glib/gstdio.h>
#include <locale.h>
#include <math.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
#define DEMO     SOURCE_DIR "/etc/demo/rig.conf"

static void spin(void) {
    while (g_main_context_iteration(NULL, FALSE))
        ;
}

static G_NO_INLINE char *demo_text(void) {
    char *text = NULL;

    ok(g_file_get_contents(DEMO, &text, NULL, ERR));
    return text;
}

static char *written(const char *text) {
    GError *error = NULL;
    g_autofree char *path = NULL;
    g_autofree char *world = g_canonicalize_filename(SOURCE_DIR "/etc/demo/world.conf", NULL);
    g_auto(GStrv) parts = g_strsplit(text, "world = world.conf", -1);
    g_autofree char *here = g_strdup_printf("world = %s", world);
    g_autofree char *moved = g_strjoinv(here, parts);
    int fd = ok(g_file_open_tmp("rig-XXXXXX.conf", &path, ERR));
    g_assert_true(g_close(fd, NULL));
    g_assert_true(g_file_set_contents(path, moved, -1, &error));
    return g_steal_pointer(&path);
}

/* Writes the demo's rig with one piece replaced. Returns its path, and the line that piece is in.
 */
static char *with(const char *from, const char *to, int *ret_line) {
    g_autofree char *text = demo_text();
    const char *at = strstr(text, from);

    g_assert_nonnull(at);
    *ret_line = 1;
    for (const char *c = text; c < at; c++)
        *ret_line += *c == '\n';
    g_autofree char *changed =
        g_strdup_printf("%.*s%s%s", (int)(at - text), text, to, at + strlen(from));
    return written(changed);
}

TEST(demo_geometry) {
    static const int theta_deg[] = {15, 30, 45, 60, 75};
    g_autoptr(GError) error = NULL;
    struct rig rig;

    g_assert_true(ok(devices_read_geometry(DEMO, &rig, ERR)));
    g_assert_cmpstr(rig.id, ==, "demo");
    g_assert_cmpint(rig.n_cameras, ==, 5);
    g_assert_cmpint(rig.n_lamps, ==, 5);
    g_assert_cmpint(rig.n_lasers, ==, 5);
    g_assert_cmpfloat(rig.arc_radius_mm, ==, 500);
    for (int i = 0; i < 5; i++) {
        double s = sin(RAD(theta_deg[i])), c = cos(RAD(theta_deg[i]));
        struct vec3 eye = rig_camera_centre_mm(&rig.cameras[i]), lamp = rig.lamps[i].position_mm;
        struct vec3 laser = rig.lasers[i].position_mm;
        double x, y;
        g_assert_cmpfloat(vec3_length(vec3_sub(eye, vec3(650 * s, 0, 650 * c))), <, 1e-9);
        g_assert_cmpfloat(vec3_length(vec3_sub(lamp, vec3(500 * s, 0, 500 * c))), <, 1e-9);
        g_assert_cmpfloat(vec3_length(vec3_sub(laser, vec3(480 * s, 0, 480 * c))), <, 1e-9);
        g_assert_cmpfloat(vec3_length(vec3_sub(rig.lamps[i].aim, vec3(-s, 0, -c))), <, 1e-12);
        /* the axis times the way to the origin: (0,1,0) × (−s,0,−c) */
        g_assert_cmpfloat(vec3_length(vec3_sub(rig.lasers[i].normal, vec3(-c, 0, s))), <, 1e-12);
        g_assert_true(rig_project(&rig.cameras[i], vec3(0, 0, 0), &x, &y));
        double cx = (rig.cameras[i].width - 1) / 2.0, cy = (rig.cameras[i].height - 1) / 2.0;
        g_assert_cmpfloat(fabs(x - cx) + fabs(y - cy), <, 1e-9);
        g_assert_true(rig_project(&rig.cameras[i], vec3(0, 25, 0), &x, &y));
        g_assert_cmpfloat(fabs(x - cx - 1664 * 25.0 / 650), <, 1e-9);
    }
    g_autofree char *text = rig_to_text(&rig);
    struct rig read;
    g_assert_true(rig_from_text(&read, text, "calibration.conf", &error));
}

struct bad {
    const char *from, *to;
    int further; /* lines from the replaced one to the one complained of; −1: no line */
    const char *says;
};

static const struct bad bad_files[] = {
    {"[rig]", "[rig two]", 0, "write [rig]"},
    {"id = demo", "id = ", 0, "id"},
    {"id = demo\n", "", -1, "id"},
    {"clock = virtual", "clock = fast", 0, "real, virtual"},
    {"arc_radius_mm = 500", "arc_radius_mm = nan", 0, "number"},
    {"arc_radius_mm = 500", "arc_radius_m = 0.5", 0, "arc_radius_mm"},
    {"[axis turntable]", "[axis table]", 0, "neither turntable"},
    {"[axis turntable]", "[axis]", 0, "[axis NAME]"},
    {"[axis turntable]", "[engine turntable]", 0, "no such section"},
    {"driver = sim-axis", "driver = sim-axes", 0, "sim-axis"},
    {"driver = sim-axis\n", "", -1, "driver"},
    {"driver = sim-axis", "driver = sim-camera", 0, "sim-axis"},
    {"part = turntable", "part = turntable\nspeed = 3", 1, "speed_deg_s"},
    {"wraps = yes", "wraps = maybe", 0, "yes nor no"},
    {"settle_ms = 150", "settle_ms = inf", 0, "number"},
    {"bank = bank", "bank = bonk", 0, "bonk"},
    {"index = 1", "index = 0", 0, "lamp15"},
    {"index = 1", "index = -1", 0, "range"},
    {"index = 1", "index = 1\ndriver = sim-lamps", 1, "driver"},
    {"theta_deg = 15", "theta_deg = 95", 0, "range"},
    {"[lamp lamp30]", "[lamp lamp15]", 0, "before"},
    {"[camera cam15]", "[camera a-name-that-is-far-too-long-for-a-camera]\npart = cam15", 0,
     "at most 31 are allowed"},
    {"phi_deg = 0\n", "", -1, "phi_deg"},
    {"\nwidth = ", "\nwidth = 0.5", 1, "whole"},
    {"sweep = sweep15", "sweep = sweep16", 0, "sweep16"},
    {"sweep = sweep15", "sweep = arc", 0, "arc"},
    {"sweep = sweep15", "sweep = sweep30", -2, "is not used"},
};

static void assert_message(const struct bad *bad, const char *path, int line, const GError *error) {
    g_test_message("%s", error->message);
    g_autofree char *where = bad->further >= 0
                                 ? g_strdup_printf("%s:%d: ", path, line + bad->further)
                                 : g_strdup_printf("%s:", path);
    g_assert_true(g_str_has_prefix(error->message, where));
    g_assert_nonnull(strstr(error->message, bad->says));
}

TEST(bad) {
    for (gsize i = 0; i < G_N_ELEMENTS(bad_files); i++) {
        const struct bad *bad = &bad_files[i];
        g_autoptr(GError) error = NULL;
        struct rig rig = {.n_cameras = 77};
        int line;
        g_autofree char *path = with(bad->from, bad->to, &line);
        g_assert_false(devices_read_geometry(path, &rig, &error));
        g_assert_nonnull(error);
        assert_message(bad, path, line, error);
        g_assert_cmpint(rig.n_cameras, ==, 77);
        g_clear_error(&error);
        g_assert_null(devices_open(path, &error));
        assert_message(bad, path, line, error);
        g_unlink(path);
    }
}

#define CAMERA                                                                                     \
    "[camera c]\ndriver=sim-camera\nworld=w.conf\ntheta_deg=0\nphi_deg=0\ndistance_mm=500\n"       \
    "width=4\nheight=4\nfocal_px=100\n"
#define LAMP                                                                                       \
    "[lamps bank]\ndriver=sim-lamps\nworld=w.conf\n[lamp a]\nbank=bank\nindex=0\ntheta_deg=30\n"   \
    "distance_mm=500\n"

/* A lamp that says where it stands needs no arc, and is where it says; overhead it need not. */
TEST(shapes) {
    static const struct {
        const char *lamp;
        gboolean fixed;
        double phi_deg;
    } lamps[] = {{LAMP "phi_deg=70\n", TRUE, 70},
                 {LAMP "[axis arc]\ndriver=sim-axis\n", FALSE, 0},
                 {LAMP "phi_deg=-20\n[axis arc]\ndriver=sim-axis\n", TRUE, 340}};

    for (gsize i = 0; i < G_N_ELEMENTS(lamps); i++) {
        struct rig rig;
        g_autofree char *text =
            g_strconcat("[rig]\nid = r\narc_radius_mm = 500\n" CAMERA, lamps[i].lamp, NULL);
        g_autofree char *path = written(text);
        double theta, phi;
        g_assert_true(ok(devices_read_geometry(path, &rig, ERR)));
        g_assert_cmpint(rig.lamps[0].fixed, ==, lamps[i].fixed);
        /* the arc's angle matters to what it carries only */
        rig_angles(rig_lamp_position_mm(&rig.arc, &rig.lamps[0], 1), &theta, &phi);
        g_assert_cmpfloat_with_epsilon(theta, 30 * G_PI / 180, 1e-9);
        g_assert_cmpfloat_with_epsilon(
            phi, lamps[i].phi_deg * G_PI / 180 + (lamps[i].fixed ? 0 : 1), 1e-9);
        g_unlink(path);
    }
}

/* About an axis at azimuth 90 the arm lowers a camera at azimuth 0, past the zenith as well; about
 * one at azimuth 0 it moves it aside. */
TEST(arm) {
    static const struct {
        const char *rig;
        double theta_deg[3], phi_deg[3]; /* at −40, 0 and 30 */
    } arms[] = {{"", {25, 15, 45}, {180, 0, 0}},
                {"arm_axis_theta_deg = 0\n", {15, 15, 15}, {320, 0, 30}}};

    for (gsize i = 0; i < G_N_ELEMENTS(arms); i++) {
        struct rig rig;
        g_autofree char *text = g_strconcat(
            "[rig]\nid = r\n", arms[i].rig,
            "[axis arm]\ndriver=sim-axis\n[camera "
            "a]\ndriver=sim-camera\nworld=w.conf\ntheta_deg=15\n"
            "phi_deg=0\narm_deg=-40;0;30\ndistance_mm=500\nwidth=4\nheight=4\nfocal_px=100\n" CAMERA
                LAMP "phi_deg=70\n",
            NULL);
        g_autofree char *path = written(text);
        g_assert_true(ok(devices_read_geometry(path, &rig, ERR)));
        g_assert_cmpint(rig.n_cameras, ==, 4);
        for (int c = 0; c < 3; c++) {
            static const char *const names[] = {"a@-40", "a@0", "a@30"};
            const struct rig_camera *camera = &rig.cameras[c];
            const struct vec3 at = rig_camera_centre_mm(camera);
            double theta, phi, x, y;
            rig_angles(at, &theta, &phi);
            g_assert_cmpstr(camera->name, ==, names[c]);
            g_assert_cmpint(rig_camera_unit(&rig, c), ==, 0);
            g_assert_cmpfloat_with_epsilon(theta, RAD(arms[i].theta_deg[c]), 1e-9);
            g_assert_cmpfloat_with_epsilon(remainder(phi - RAD(arms[i].phi_deg[c]), 2 * G_PI), 0,
                                           1e-9);
            g_assert_cmpfloat_with_epsilon(vec3_length(at), 500, 1e-9);
            g_assert_true(rig_project(camera, vec3(0, 0, 0), &x, &y)); /* still at the middle */
            g_assert_cmpfloat(hypot(x - 1.5, y - 1.5), <, 1e-9);
        }
        g_assert_cmpint(rig_camera_unit(&rig, 3), ==, 3);
        g_unlink(path);
    }
}

TEST(bad_arms) {
    g_autoptr(GString) many = g_string_new("arm_deg=0");
    for (int i = 1; i <= 256; i++) /* 257 stops */
        g_string_append_printf(many, ";%g", 0.25 * i);
    g_string_append_c(many, '\n');
    const struct {
        const char *rig, *camera, *says;
    } bad[] = {
        {"", "arm_deg=0;10\n", "there is no section [axis arm]"},
        {"[axis arm]\ndriver=sim-axis\n", "", "this axis is not used"},
        {"[axis arm]\ndriver=sim-axis\n", "arm_deg=0;10;0\n", "is given twice"},
        {"[axis arm]\ndriver=sim-axis\n", "arm_deg=0;100\n", "below the turntable's top"},
        {"[axis arm]\ndriver=sim-axis\n", "arm_deg=0;x\n", "arm_deg"},
        {"[axis arm]\ndriver=sim-axis\n", many->str, "at most 256 are allowed"},
        {"[axis probe]\ndriver=sim-axis\n", "", "this axis is not used"},
    };

    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        struct rig rig;
        g_autofree char *text = g_strconcat("[rig]\nid = r\n", bad[i].rig,
                                            LAMP "phi_deg=70\n" CAMERA, bad[i].camera, NULL);
        g_autofree char *path = written(text);
        g_assert_false(devices_read_geometry(path, &rig, &error));
        g_test_message("%s", error->message);
        g_assert_nonnull(strstr(error->message, bad[i].says));
        g_unlink(path);
    }
}

TEST(missing) {
    static const char *const head = "[rig]\nid = r\n";
    static const char *const texts[][2] = {
        {"", "[rig]"},
        {"%s", "[camera"},
        {"%s[axis turntable]\ndriver=sim-axis\n[axis arc]\ndriver=sim-axis\n", "[camera"},
        {"%s" CAMERA, "[lamp NAME]"},
        {"%s" CAMERA LAMP, "[lamp a] phi_deg: must be given"},
        {"%s" CAMERA LAMP "phi_deg=3\n[axis arc]\ndriver=sim-axis\n", "arc_radius_mm"},
    };
    struct rig rig;

    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_auto(GStrv) parts = g_strsplit(texts[i][0], "%s", -1);
        g_autofree char *text = g_strjoinv(head, parts);
        g_autofree char *path = written(text);
        g_autoptr(GError) error = NULL;
        g_assert_false(devices_read_geometry(path, &rig, &error));
        g_assert_nonnull(strstr(error->message, texts[i][1]));
        g_unlink(path);
    }
    g_autoptr(GError) error = NULL;
    g_assert_null(devices_open("/no/such/rig.conf", &error));
    g_assert_nonnull(strstr(error->message, "/no/such/rig.conf"));
}

TEST(truncated) {
    g_autofree char *text = demo_text();
    gsize length = strlen(text);

    for (gsize n = 0; n < length; n += 7) {
        g_autofree char *part = g_strndup(text, n);
        g_autofree char *path = written(part);
        g_autoptr(GError) error = NULL;
        struct rig rig;
        if (!devices_read_geometry(path, &rig, &error))
            g_assert_nonnull(error);
        g_unlink(path);
    }
}

TEST(open) {
    g_autoptr(GError) error = NULL;
    struct devices *devices = devices_open(DEMO, &error);
    struct rig rig;

    g_assert_no_error(error);
    g_assert_nonnull(devices);
    g_assert_true(clock_is_virtual(devices->clock));
    g_assert_true(devices_read_geometry(DEMO, &rig, &error));
    g_autofree char *said = rig_to_text(&rig), *has = rig_to_text(&devices->geometry);
    g_assert_cmpstr(said, ==, has);
    g_assert_cmpfloat(devices->timing.turntable.speed_deg_s, ==, 60);
    g_assert_true(devices->timing.turntable.wraps);
    g_assert_cmpfloat(devices->timing.arc.backlash_deg, ==, 0.1);
    g_assert_cmpint(devices->n_banks, ==, 1);
    for (int i = 0; i < 5; i++) {
        g_assert_true(devices->lamps[i].bank == devices->banks[0]);
        g_assert_cmpint(devices->lamps[i].index, ==, i);
        g_assert_cmpfloat(devices->timing.sweep[i].max_deg, ==, 15);
        g_assert_cmpint(devices->timing.readout_us[i], >, 0);
        g_assert_cmpint(devices->timing.bits[i], ==, 12);
        g_assert_false(laser_is_on(devices->lasers[i]));
    }
    g_assert_true(g_path_is_absolute(devices->path));
    g_assert_nonnull(strstr(devices->text, "[camera cam75]"));
    spin();
    g_assert_true(devices_make_safe(devices, &error));
    spin();
    devices_close(devices);
    devices_close(NULL);
    spin();
}

static void count_safety(struct device *device, const GError *error, gpointer data) {
    GString *told = data;
    g_string_append_printf(told, "%s %s; ", device->who, error ? "unsafe" : "safe");
}

static gboolean count_permit(const struct device *device, gpointer data, GError **error) {
    g_hash_table_add(data, (gpointer)device);
    return device_error_set(error, DEVICE_ERROR_BUSY, device->who, "not permitted");
}

/* Each device asks for a permit and is watched, once. */
TEST(permit_and_watch) {
    g_autoptr(GString) told = g_string_new(NULL);
    g_autoptr(GHashTable) asked = g_hash_table_new(NULL, NULL);
    int line, n_devices = 0;
    g_autofree char *path =
        with("[laser laser15]\n", "[laser laser15]\nfault_unheard = 1\n", &line);
    struct devices *devices = ok(devices_open(path, ERR));
    devices_watch_safety(devices, count_safety, told);
    devices_set_permit(devices, count_permit, asked);
    for (int i = 0; i < devices->geometry.n_lasers; i++, n_devices++) {
        g_assert_false(laser_set(devices->lasers[i], TRUE, NULL));
        for (int k = 0; k < i; k++)
            n_devices -= devices->lasers[k] == devices->lasers[i];
    }
    for (int i = 0; i < devices->n_banks; i++, n_devices++)
        g_assert_false(lamps_set(devices->banks[i], 0, TRUE, NULL));
    for (int i = 0; i < DEVICES_POSITIONERS; i++) {
        n_devices += devices_positioner(devices, i) != NULL;
        g_assert_true(!devices_positioner(devices, i) ||
                      !axis_home(devices_positioner(devices, i), NULL));
    }
    for (int i = 0; i < devices->geometry.n_lasers; i++) {
        int first = 0;
        while (devices->sweeps[first] != devices->sweeps[i])
            first++;
        n_devices += first == i;
        g_assert_false(axis_home(devices->sweeps[i], NULL));
    }
    g_assert_cmpuint(g_hash_table_size(asked), ==, n_devices);
    conformance_pass(devices->clock, 1);
    g_assert_cmpstr(told->str, ==, "");

    devices_set_permit(devices, NULL, NULL);
    g_assert_true(laser_set(devices->lasers[0], TRUE, NULL));
    conformance_pass(devices->clock, 3);
    g_assert_cmpstr(told->str, ==, "laser laser15 unsafe; laser laser15 safe; ");
    g_assert_false(devices_any_unsafe(devices));
    devices_close(devices);
    g_unlink(path);
    spin();
}

static char *safety_of(const struct devices *devices, enum device_safety expected) {
    enum device_safety safety;
    g_autoptr(GVariant) list = g_variant_ref_sink(devices_safety(devices, &safety));
    g_assert_cmpint(safety, ==, (int)expected);
    return g_variant_print(list, FALSE);
}

/* What was only commanded is told apart from what has answered, and from what has not in time: the
 * demo's first laser does not hear its first "off", and is told again until it does. */
TEST(safety) {
    g_autoptr(GError) error = NULL;
    int line;
    g_autofree char *path = with("[laser laser15]\n", "[laser laser15]\nfault_deaf = 1\n", &line);
    struct devices *devices = ok(devices_open(path, ERR));
    conformance_pass(devices->clock, 1);
    g_autofree char *at_first = safety_of(devices, DEVICE_SAFE);
    g_assert_null(strstr(at_first, "NOT safe"));
    g_assert_true(laser_set(devices->lasers[0], TRUE, NULL));
    conformance_pass(devices->clock, 1);
    g_autofree char *lit = safety_of(devices, DEVICE_UNSAFE);
    assert_has(lit, "NOT safe");

    g_assert_true(devices_make_safe(devices, &error));
    g_autofree char *told = safety_of(devices, DEVICE_TOLD);
    assert_has(told, "('laser', 'laser15', 'commanded only')");
    conformance_pass(devices->clock, 1);
    g_autofree char *deaf = safety_of(devices, DEVICE_TOLD);
    assert_has(deaf, "('laser', 'laser15', 'commanded only'), ('laser', 'laser30', 'read back')");
    assert_has(deaf, "('axis', 'turntable', 'read back')");
    while (!devices_any_unsafe(devices))
        g_main_context_iteration(NULL, TRUE);
    g_autofree char *late = safety_of(devices, DEVICE_UNSAFE);
    assert_has(late, "('laser', 'laser15', 'NOT safe')");

    conformance_pass(devices->clock, 1);
    g_assert_false(devices_any_unsafe(devices));
    g_autofree char *off = safety_of(devices, DEVICE_SAFE);
    assert_has(off, "('laser', 'laser15', 'read back')");
    devices_close(devices);
    g_unlink(path);
    spin();
}

/* What only the opened devices know. */
TEST(open_refused) {
    static const struct bad files[] = {
        {"\nwidth = ", "\nwidth = 1", 1, "pictures are"},
        {"\nheight = ", "\nheight = 1", 1, "write width = "},
        {"index = 4", "index = 5", 0, "0 to 4"},
    };

    for (gsize i = 0; i < G_N_ELEMENTS(files); i++) {
        g_autoptr(GError) error = NULL;
        int line;
        g_autofree char *path = with(files[i].from, files[i].to, &line);
        g_assert_null(devices_open(path, &error));
        g_assert_nonnull(error);
        assert_message(&files[i], path, line, error);
        g_unlink(path);
        spin();
    }
}

/* Two interlocks: one open is enough to keep the lasers off. */
TEST(two_interlocks) {
    g_autofree char *text = demo_text();
    g_autofree char *more = g_strconcat(
        text, "\n[interlock lid]\ndriver = sim-interlock\nopen_after_s = 1\nopen_for_s = 2\n",
        NULL);
    g_autofree char *path = written(more);
    g_autoptr(GError) error = NULL;
    struct devices *devices = ok(devices_open(path, ERR));
    g_assert_cmpint(devices->n_interlocks, ==, 2);
    clock_hold(devices->clock);
    spin();
    g_assert_true(interlock_is_closed(devices->guard));
    g_assert_true(laser_set(devices->lasers[0], TRUE, &error));
    clock_release(devices->clock);
    while (interlock_is_closed(devices->interlocks[1]))
        g_main_context_iteration(NULL, TRUE);
    clock_hold(devices->clock);
    g_assert_true(interlock_is_closed(devices->interlocks[0]));
    g_assert_false(interlock_is_closed(devices->guard));
    g_assert_false(laser_set(devices->lasers[1], TRUE, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_INTERLOCK);
    g_clear_error(&error);
    clock_release(devices->clock);
    while (!interlock_is_closed(devices->guard))
        g_main_context_iteration(NULL, TRUE);
    g_assert_false(laser_is_on(devices->lasers[0]));
    g_assert_true(laser_set(devices->lasers[1], TRUE, &error));
    devices_close(devices);
    spin();
    g_unlink(path);
}

/* The demo's two files together: a plan within 5 % of what no order can beat. */
TEST(demo_plan) {
    g_autoptr(GError) error = NULL;
    struct devices *devices = devices_open(DEMO, &error);
    g_auto(SessionConf) conf = {0};

    g_assert_no_error(error);
    g_assert_true(session_conf_load(&conf, SOURCE_DIR "/etc/demo/session.conf", &error));
    g_autoptr(Plan) plan = plan_build(&conf, &devices->geometry, &devices->timing, &error);
    g_assert_no_error(error);
    g_test_message("predicted %.0f s, bound %.0f s, nested %.0f s, %d poses, %d frames",
                   plan->predicted_s, plan->lower_bound_s, plan->nested_s, plan->n_poses,
                   plan->n_frames);
    g_assert_cmpfloat(plan->predicted_s, <=, 1.05 * plan->lower_bound_s);
    g_assert_cmpuint(plan->notes->len, ==, 0);
    devices_close(devices);
    spin();
}

TEST(describe) {
    g_autofree char *all = devices_describe_drivers(NULL, FALSE);
    g_autofree char *json = devices_describe_drivers(NULL, TRUE);
    g_autofree char *one = devices_describe_drivers("sim-axis", TRUE);

    g_assert_nonnull(strstr(all, "sim-camera"));
    g_assert_null(strstr(all, "arc_radius_mm")); /* an option; a line each is without them */
    g_assert_nonnull(strstr(json, "arc_radius_mm"));
    g_assert_nonnull(strstr(one, "\"speed_deg_s\""));
    g_assert_null(strstr(one, "sim-camera"));
    g_assert_true(g_str_has_prefix(json, "[{") && g_str_has_suffix(json, "}]"));
    g_assert_null(strstr(json, "}{"));
    g_assert_null(devices_describe_drivers("no-such", FALSE));
    g_assert_null(devices_describe_drivers("no-such", TRUE));
}

BEFORE_TESTS {
    setlocale(LC_ALL, "");
}
