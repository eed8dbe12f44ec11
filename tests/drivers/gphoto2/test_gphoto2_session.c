/* A session in a dome of lamps with a still camera. With faults of the camera all the time, it has
 * the same frames as without faults, bit for bit. The short form has 3 lamps, 14 pictures
 * and 7 kinds of faults. With MESORIG_DOME set, it has 41 lamps, 1030 pictures and all kinds.
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

#include <math.h>
#include <string.h>

#define RING_DEG 16 /* between two rings of lamps */
#define MIN_GAP  2  /* smallest number of pictures from one fault to the next */
#define MAX_LATE 2  /* exposures */

#define CAMERA                                                                                     \
    "[camera top]\ntheta_deg = 30\nphi_deg = 0\ndistance_mm = 650\nwidth = 36\nheight = 36\n"      \
    "focal_px = 333\nresponse = 6000\n"

/* A fault that happens to the picture that is just taken, or to the next one. */
struct kind {
    const char *name;
    struct virtual_ptpip_faults faults;
    /* The session pauses, its reason has these words, and the fault lasts until somebody has
     * mended it. NULL: the session does not pause. */
    const char *pauses;
};

static const struct kind kinds[] = {
    {"busy", {.busy = 3}, NULL},
    {"late", {.late = 1}, NULL},             /* by up to MAX_LATE exposures */
    {"unanswered", {.unanswered = 1}, NULL}, /* its picture stays on the card … */
    {"unsaid", {.unsaid = 1}, NULL},         /* … where the next one is looked for */
    {"unplugged", {.unplugged = TRUE}, "cannot be opened"},
    {"card full", {.full = TRUE}, "card of the camera is full"},
    {"battery empty", {.blind = G_MAXINT, .battery = 4}, "battery of the camera is at 4 %"},
    {"incomplete", {.incomplete = 1}, NULL},
    {"complete first", {.complete_first = TRUE}, NULL},
    {"dropped", {.dropped = 1}, NULL},
    {"stalled", {.stalled = 1}, NULL},
    {"blind", {.blind = 1}, NULL},
};

/* One lamp at the zenith, and rings that look alike from each stop of the turntable. */
struct dome {
    int n_rings, n_in_ring, n_stops;
    const char *exposures; /* of each lamp at each stop */
    int n_exposures;
    int n_kinds;  /* number of kinds of faults, from the beginning of the table */
    int n_rounds; /* number of times that each of them comes */
    int max_gap;  /* largest number of pictures from one fault to the next */
};

static const struct dome small = {1, 2, 2, "4000; 100000", 2, 7, 1, MIN_GAP};
static const struct dome large = {
    4, 10, 5, "4000; 8000; 16000; 32000; 100000", 5, G_N_ELEMENTS(kinds), 10, 14};

struct bench {
    const char *folder;
    struct dome dome;
    int n_lamps;
    double intensity; /* of the lamps */
    World *world;
    VirtualPtpip *device;
    GString *told;

    GMutex mutex; /* guards the following members, which the thread of the camera changes */
    gboolean disturbed;
    GRand *rand;
    int order[G_N_ELEMENTS(kinds)]; /* a permutation of the kinds of faults */
    int n_faults;
    guint64 next; /* number of the picture that brings the next fault */
    int counts[G_N_ELEMENTS(kinds)];
    const struct kind *lasting; /* the fault that somebody has to mend; NULL if there is none */
};

/* Brings the next fault, if its time has come. The first one makes the camera busy when the second
 * picture is taken. All kinds come once in the order of the table, and then once in a random order
 * in each further round. A fault replaces the one before, and therefore comes two pictures later at
 * the earliest. */
static void disturb(struct bench *bench, guint64 picture) {
    const int n = bench->dome.n_kinds, at = bench->n_faults % n;
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&bench->mutex);
    if (!bench->disturbed || bench->lasting || picture < bench->next ||
        bench->n_faults >= n * bench->dome.n_rounds)
        return;
    for (int i = bench->n_faults > 0 ? n : 0; at == 0 && i > 1; i--) {
        const int k = g_rand_int_range(bench->rand, 0, i), last = bench->order[i - 1];
        bench->order[i - 1] = bench->order[k];
        bench->order[k] = last;
    }
    const struct kind *kind = &kinds[bench->order[at]];
    struct virtual_ptpip_faults faults = kind->faults;
    faults.late_exposures = faults.late ? g_rand_double_range(bench->rand, 0, MAX_LATE) : 0;
    bench->lasting = kind->pauses ? kind : NULL;
    bench->next =
        picture + (guint64)g_rand_int_range(bench->rand, MIN_GAP, bench->dome.max_gap + 1);
    bench->counts[bench->order[at]]++;
    bench->n_faults++;
    virtual_ptpip_fail(bench->device, &faults);
}

/* The same light and pose give the same picture, so that a picture that is taken again is the same.
 * Others have other noise. */
static void take_picture(const struct virtual_exposure *exposure, gpointer data,
                         guint16 *ret_pixels) {
    struct bench *bench = data;
    struct world_state state;
    guint64 key = (guint64)exposure->exposure_us;
    world_snapshot(bench->world, exposure->start_us, exposure->exposure_us, &state);
    key = key * 360 + (guint64)lround(state.turntable_deg);
    for (int i = 0; i < bench->n_lamps; i++)
        key = key * 31 + (state.lamp_output[i] > 0);
    world_expose(bench->world, 0, &state, exposure->exposure_us, 0, key, ret_pixels);
    disturb(bench, exposure->n);
}

static void write_lamps(const struct bench *bench, gboolean rig, GString *to) {
    for (int i = 0; i < bench->n_lamps; i++) {
        const int place = MAX(i - 1, 0), n = bench->dome.n_in_ring;
        const int ring = i > 0 ? 1 + place / n : 0;
        g_string_append_printf(to, "[lamp l%d]\n", i);
        if (rig)
            g_string_append_printf(to, "bank = bank\nindex = %d\n", i);
        g_string_append_printf(to,
                               "theta_deg = %d\nphi_deg = %g\ndistance_mm = 500\n"
                               "intensity = %g\nexponent = 2\n",
                               ring * RING_DEG, place % n * 360.0 / n, bench->intensity);
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
                    "[axis turntable]\ndriver = sim-axis\nworld = world.conf\npart = turntable\n"
                    "wraps = yes\nspeed_deg_s = 720\naccel_deg_s2 = 7200\nringing_deg = 0\n"
                    "settle_ms = 10\nhoming_s = 0.1\n"
                    "[lamps bank]\ndriver = sim-lamps\nworld = world.conf\n" CAMERA
                    "driver = gphoto2-camera\nport = %s\ntrigger_ms = 100\nreadout_ms = 500\n",
                    virtual_ptpip_port(bench->device));
    write_lamps(bench, TRUE, rig);
    text_file_write(bench->folder, "rig.conf", rig->str);
    g_autofree char *session =
        g_strdup_printf("[session]\nname = still\n[sample]\nwidth_mm = 50\nheight_mm = 50\n"
                        "texels = 8\nreference_mm = 5\ndepth_mm = 5\n"
                        "[views]\nrings = 30:%d\n[lights]\ndevices = all\n"
                        "[capture]\nexposures_us = %s\ndark_frames = 1\nkeep_exposures = yes\n",
                        bench->dome.n_stops, bench->dome.exposures);
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

static void on_changed(Capture *capture, gpointer data) {
}

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    g_string_append_printf(((struct bench *)data)->told, "%s %s: %s\n", level, source, message);
}

static void set_disturbed(struct bench *bench, gboolean disturbed) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&bench->mutex);
    bench->disturbed = disturbed;
    bench->lasting = NULL;
    virtual_ptpip_fail(bench->device, &(struct virtual_ptpip_faults){0});
}

/* Mends the fault for which the session has paused, as the operator does, and continues. */
static void mend(struct bench *bench, Capture *capture, const char *reason) {
    g_mutex_lock(&bench->mutex);
    const struct kind *lasting = bench->lasting;
    g_mutex_unlock(&bench->mutex);
    if (!lasting)
        g_error("paused without a fault that lasts: %s; told so far:\n%s", reason,
                bench->told->str);
    assert_has(reason, lasting->pauses);
    set_disturbed(bench, TRUE);
    ok(capture_continue(capture, ERR));
}

/* Captures a session from beginning to end. Returns its path; g_free(). */
static char *capture_session(struct bench *bench, const char *name, gboolean disturbed) {
    const struct capture_callbacks callbacks = {on_changed, on_event, bench};
    g_autofree char *rig = g_build_filename(bench->folder, "rig.conf", NULL);
    g_autofree char *conf_path = g_build_filename(bench->folder, "session.conf", NULL);
    char *path = g_build_filename(bench->folder, name, NULL);
    const gint64 begun_us = g_get_monotonic_time();
    struct session_conf conf;
    struct capture_status status;
    int n_pauses = 0;
    struct devices *devices = ok(devices_open(rig, ERR));
    ok(session_conf_load(&conf, conf_path, ERR));
    set_disturbed(bench, disturbed);
    Capture *capture = ok(capture_start(devices, &conf, path, &callbacks, ERR));
    for (capture_get_status(capture, &status); status.state != CAPTURE_DONE;
         capture_get_status(capture, &status)) {
        if (status.state == CAPTURE_PAUSED) {
            mend(bench, capture, status.reason);
            n_pauses++;
        }
        g_main_context_iteration(NULL, TRUE);
    }
    g_print("# %s: %.1f s, %d faults, %d pauses, %d frames taken again\n", name,
            (double)(g_get_monotonic_time() - begun_us) / 1e6, bench->n_faults, n_pauses,
            (int)status.retakes);
    set_disturbed(bench, FALSE);
    capture_free(capture);
    session_conf_clear(&conf);
    devices_close(devices);
    return path;
}

static void begin(struct bench *bench, const char *folder) {
    bench->folder = folder;
    bench->n_lamps = 1 + bench->dome.n_rings * bench->dome.n_in_ring;
    bench->rand = g_rand_new_with_seed(41);
    for (int i = 0; i < (int)G_N_ELEMENTS(kinds); i++)
        bench->order[i] = i;
    g_mutex_init(&bench->mutex);
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
    g_mutex_clear(&bench->mutex);
}

/* Checks that each picture of which the frames are made is the same in both sessions. Returns the
 * number of pictures. */
static int check_same_pictures(const char *expected_path, const char *session_path) {
    g_autoptr(GPtrArray) frames = run_frames(expected_path);
    int n = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_autofree char *relative = g_strndup(frame->path, strlen(frame->path) - strlen(".exr"));
        g_autofree char *folder = g_build_filename(expected_path, relative, NULL);
        g_autoptr(GDir) dir = ok(g_dir_open(folder, 0, ERR));
        for (const char *name; (name = g_dir_read_name(dir)); n++) {
            g_autofree char *path = g_build_filename(relative, name, NULL);
            run_check_same_file(expected_path, session_path, path);
        }
    }
    return n;
}

TEST(disturbed) {
    TEMPORARY_FOLDER(folder);
    struct bench bench = {.dome = g_getenv("MESORIG_DOME") ? large : small, .intensity = 40};
    begin(&bench, folder);
    const int n = (bench.n_lamps * bench.dome.n_stops + 1) * bench.dome.n_exposures;
    g_autofree char *calm = capture_session(&bench, "calm.session", FALSE);
    g_autofree char *disturbed = capture_session(&bench, "disturbed.session", TRUE);
    run_check_whole(calm);
    run_check_whole(disturbed);
    run_check_same_frames(calm, disturbed);
    g_assert_cmpint(check_same_pictures(calm, disturbed), ==, n);
    for (int i = 0; i < bench.dome.n_kinds; i++) {
        g_test_message("%s: %d", kinds[i].name, bench.counts[i]);
        g_assert_cmpint(bench.counts[i], ==, bench.dome.n_rounds);
    }
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
        struct bench bench = {.dome = {0, 1, 1, cases[i].exposures, 1, 1, 0, MIN_GAP},
                              .intensity = 400};
        begin(&bench, folder);
        g_autofree char *session = capture_session(&bench, "bright.session", FALSE);
        run_check_whole(session);
        g_assert_cmpint(strstr(bench.told->str, "the picture is taken again at 4000 µs") != NULL,
                        ==, cases[i].has_quarter);
        end(&bench);
    }
}
