/* A session under many lamps with a still camera: with faults of the camera all the time, it has
 * the same frames as without faults, bit for bit. MESORIG_LAMPS is the number of lamps, up to 41.
 */
#include "lib/capture_run.h"
#include "lib/capture_steps.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/text_file.h"

#include "virtual/cameras/ptpip.h"
#include "world/world.h"

#include <string.h>

#define SIDE      36
#define MAX_LAMPS 41
#define FEW_LAMPS 6 /* of the short form */
#define FAULT_MS  1200

#define CAMERA                                                                                     \
    "[camera top]\ntheta_deg = 0\nphi_deg = 0\ndistance_mm = 650\nwidth = 36\nheight = 36\n"       \
    "focal_px = 333\nresponse = 6000\n"

struct bench {
    const char *folder;
    int n_lamps;
    double intensity;      /* of the lamps */
    const char *exposures; /* of the session */
    World *world;
    VirtualPtpip *device;
    GRand *rand;
    int n_faults;
    GString *told;
};

/* The same light gives the same picture, so that a picture that is taken again is the same. */
static void take_picture(const struct virtual_exposure *exposure, gpointer data,
                         guint16 *ret_pixels) {
    const struct bench *bench = data;
    struct world_state state;
    guint64 key = (guint64)exposure->exposure_us;
    world_snapshot(bench->world, exposure->start_us, exposure->exposure_us, &state);
    for (int i = 0; i < bench->n_lamps; i++)
        key = key * 31 + (state.lamp_output[i] > 0);
    world_expose(bench->world, 0, &state, exposure->exposure_us, 0, key, ret_pixels);
}

static void write_lamps(const struct bench *bench, gboolean rig, GString *to) {
    for (int i = 0; i < bench->n_lamps; i++) {
        g_string_append_printf(to, "[lamp l%d]\n", i);
        if (rig)
            g_string_append_printf(to, "bank = bank\nindex = %d\n", i);
        g_string_append_printf(to,
                               "theta_deg = %d\nphi_deg = %d\ndistance_mm = 500\n"
                               "intensity = %g\nexponent = 2\n",
                               10 + 60 * i / MAX_LAMPS, 137 * i % 360, bench->intensity);
    }
}

static void write_world(const struct bench *bench) {
    g_autoptr(GString) world =
        g_string_new("[world]\nseed = 7\nsupersample = 1\ngather_rays = 0\nwarm_up_s = 0.02\n"
                     "[sample]\nkind = flat\nwidth_mm = 50\nheight_mm = 50\n" CAMERA);
    write_lamps(bench, FALSE, world);
    text_file_write(bench->folder, "world.conf", world->str);
}

static void write_rig(const struct bench *bench) {
    g_autoptr(GString) rig = g_string_new(NULL);
    g_string_printf(rig,
                    "[rig]\nid = still\nclock = real\n"
                    "[lamps bank]\ndriver = sim-lamps\nworld = world.conf\n" CAMERA
                    "driver = gphoto2-camera\nport = %s\ntrigger_ms = 100\nreadout_ms = 500\n",
                    virtual_ptpip_port(bench->device));
    write_lamps(bench, TRUE, rig);
    text_file_write(bench->folder, "rig.conf", rig->str);
    g_autofree char *session =
        g_strdup_printf("[session]\nname = still\n[sample]\nwidth_mm = 50\nheight_mm = 50\n"
                        "texels = 8\nreference_mm = 5\ndepth_mm = 5\n"
                        "[views]\ndevices = all\n[lights]\ndevices = all\n"
                        "[capture]\nexposures_us = %s\ndark_frames = 1\nretries = 20\n",
                        bench->exposures);
    text_file_write(bench->folder, "session.conf", session);
}

/* Makes a camera of the world. */
static void make_camera(struct bench *bench) {
    struct world_sensor sensor;
    g_autofree char *path = g_build_filename(bench->folder, "world.conf", NULL);
    bench->world = ok(world_get(path, ERR));
    world_sensor(bench->world, 0, &sensor);
    const struct virtual_ptpip_options options = {.width = sensor.width,
                                                  .height = sensor.height,
                                                  .bits = sensor.bits,
                                                  .cfa = sensor.cfa,
                                                  .black_level = sensor.black_level,
                                                  .picture = take_picture,
                                                  .data = bench};
    bench->device = ok(virtual_ptpip_new(&options, ERR));
}

/* One of the faults happens with the next picture. */
static gboolean disturb(gpointer data) {
    static const struct virtual_ptpip_faults kinds[] = {
        {.busy = 3},
        {.incomplete = 1},
        {.unsaid = 1},
        {.late = 1, .late_exposures = 2},
        {.complete_first = TRUE},
        {.dropped = 1},
        {.stalled = 1},
        {.blind = 1},
        {.unanswered = 1},
        {0},
    };
    struct bench *bench = data;
    virtual_ptpip_fail(bench->device,
                       &kinds[g_rand_int_range(bench->rand, 0, G_N_ELEMENTS(kinds))]);
    bench->n_faults++;
    return G_SOURCE_CONTINUE;
}

static void on_changed(Capture *capture, gpointer data) {
}

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    g_string_append_printf(((struct bench *)data)->told, "%s %s: %s\n", level, source, message);
}

/* Captures a session from beginning to end. Returns its path; g_free(). */
static char *capture_session(struct bench *bench, const char *name, gboolean disturbed) {
    const struct capture_callbacks callbacks = {on_changed, on_event, bench};
    g_autofree char *rig = g_build_filename(bench->folder, "rig.conf", NULL);
    g_autofree char *conf_path = g_build_filename(bench->folder, "session.conf", NULL);
    char *path = g_build_filename(bench->folder, name, NULL);
    struct session_conf conf;
    struct capture_status status;
    struct devices *devices = ok(devices_open(rig, ERR));
    ok(session_conf_load(&conf, conf_path, ERR));
    Capture *capture = ok(capture_start(devices, &conf, path, &callbacks, ERR));
    const guint timer = disturbed ? g_timeout_add(FAULT_MS, disturb, bench) : 0;
    for (capture_get_status(capture, &status); status.state < CAPTURE_PAUSED;
         capture_get_status(capture, &status))
        g_main_context_iteration(NULL, TRUE);
    if (status.state != CAPTURE_DONE)
        g_error("not done: %s; told so far:\n%s", status.reason, bench->told->str);
    g_test_message("%s: %.1f s, %d faults, %d frames taken again", name, status.elapsed_s,
                   bench->n_faults, (int)status.retakes);
    if (timer > 0)
        g_source_remove(timer);
    virtual_ptpip_fail(bench->device, &(struct virtual_ptpip_faults){0});
    capture_free(capture);
    session_conf_clear(&conf);
    devices_close(devices);
    return path;
}

static void begin(struct bench *bench, const char *folder) {
    bench->folder = folder;
    bench->rand = g_rand_new_with_seed(41);
    bench->told = g_string_new(NULL);
    g_setenv("HOME", folder, TRUE); /* for the settings of libgphoto2 */
    write_world(bench);
    make_camera(bench);
    write_rig(bench);
}

static void end(struct bench *bench) {
    virtual_ptpip_free(bench->device);
    world_unref(bench->world);
    g_rand_free(bench->rand);
    g_string_free(bench->told, TRUE);
}

TEST(disturbed) {
    TEMPORARY_FOLDER(folder);
    const char *wanted = g_getenv("MESORIG_LAMPS");
    struct bench bench = {.n_lamps = wanted ? MIN(atoi(wanted), MAX_LAMPS) : FEW_LAMPS,
                          .intensity = 40,
                          .exposures = "4000; 16000"};
    struct virtual_ptpip_state state;
    begin(&bench, folder);
    g_autofree char *calm = capture_session(&bench, "calm.session", FALSE);
    virtual_ptpip_state(bench.device, &state);
    g_assert_cmpint(state.on_card, ==, 0);
    g_autofree char *disturbed = capture_session(&bench, "disturbed.session", TRUE);
    run_check_whole(disturbed);
    run_check_same_frames(calm, disturbed);
    g_assert_cmpint(bench.n_faults, >, 5);
    end(&bench);
}

/* A saturated picture is taken again at a quarter of its exposure, if the camera has that time. */
TEST(saturated) {
    static const struct {
        const char *exposures;
        gboolean has_quarter;
    } cases[] = {{"16000", TRUE}, {"10000", FALSE}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        TEMPORARY_FOLDER(folder);
        struct bench bench = {.n_lamps = 1, .intensity = 400, .exposures = cases[i].exposures};
        begin(&bench, folder);
        g_autofree char *session = capture_session(&bench, "bright.session", FALSE);
        run_check_whole(session);
        g_assert_cmpint(strstr(bench.told->str, "it is taken again at 4000 µs") != NULL, ==,
                        cases[i].has_quarter);
        end(&bench);
    }
}
