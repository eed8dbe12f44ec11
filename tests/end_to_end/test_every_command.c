/*
 * Every command and program, each where users run it: on an ordinary file system, on FUSE without
 * RENAME_NOREPLACE and without reserved space, and in a locale with decimal commas. All three make
 * the same files with the same contents, and say the same numbers. Then all of it once more over
 * the files that are there: what Mesorig wrote itself is replaced, other files are refused and
 * taken with --force.
 */
#include "calibration/calibration.h"
#include "cli/commands.h"
#include "lib/ok.h"
#include "rig/devices.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "lib/process.h"
#include "lib/refusing.h"
#include "lib/remove_tree.h"
#include "lib/small_rig.h"
#include "lib/test.h"
#include "lib/trace_fixture.h"

#define BIN BUILD_DIR "/bin/"

/* What happens when a call meets its own output. */
enum again {
    AGAIN_NOTHING, /* it has no output, or is not called again */
    AGAIN_OWN,     /* it replaces it, and says so */
    AGAIN_REFUSED, /* refused, and --force replaces it */
    AGAIN_STAYS,   /* refused; a session, for which there is no --force, or one that takes long */
};

/* Calls in their order. command: of the table of commands, or a program. A call that is expected to
 * fail reads its files and arguments. */
static const struct call_case {
    const char *command, *arguments;
    enum again again;
    int code;
} calls[] = {
    {"drivers", ""},
    {"plan", "rig.conf session.conf --offline"},
    {"plan", "rig.conf session.conf --curve plan.svg", AGAIN_OWN},
    {"devices", ""},
    {"conformance", "--list --class lamps"},
    {"new-rig", "new.conf --kind arc --lamps 5 --radius 400", AGAIN_REFUSED},
    {"capture", "rig.conf session.conf -o small.session", AGAIN_STAYS},
    {"resume", "small.session"}, /* all is there */
    {"verify", "small.session"},
    {"process", "small.session"},
    {"info", "small.session --history history.svg", AGAIN_OWN},
    {"info", "small.session --history history.png", AGAIN_OWN},
    {"check", "small.session --plot energy.svg", AGAIN_OWN},
    {"compress", "small.session -m hsh -o hsh.exr", AGAIN_OWN},
    {"compress", "small.session -k 2 --components 3"},
    {"compress", "small.session -m mdf -o distances.exr", AGAIN_OWN},
    {"compare", "small.session hsh.exr --plot compared.svg", AGAIN_OWN},
    {"compare", "small.session --leave-out views=1 -m ptm"},
    {"synthesize", "small.session -m quilting --size 32x32 -o index.exr", AGAIN_OWN},
    {"report", "small.session -o report.html --crate", AGAIN_OWN},
    {"board", "board.pdf --board 8x8,square=9.5,marker=6.75", AGAIN_OWN},
    {"board", "board.svg --board 8x8,square=9.5,marker=6.75", AGAIN_OWN},
    {"board", "board.png --board 8x8,square=9.5,marker=6.75 --pixels 1.5", AGAIN_OWN},
    {"resample", "small.session -o resampled.session", AGAIN_STAYS},
    {"export btf", "small.session -o small.btf", AGAIN_REFUSED},
    {"export points", "small.session -o points.ply", AGAIN_OWN},
    {"export mesh", "small.session -o mesh.ply", AGAIN_OWN},
    {"export height", "small.session -o height.exr --layered", AGAIN_OWN},
    {"export normals", "small.session -o normals.exr --layered", AGAIN_OWN},
    {"export web", "small.session -o page.html", AGAIN_OWN},
    {"export web", "small.session -o page.mesoweb", AGAIN_REFUSED},
    {"export maps", "small.session -o maps", AGAIN_REFUSED},
    {"export gltf", "small.session -o small.glb", AGAIN_REFUSED},
    {"export gltf", "small.session -o text.gltf", AGAIN_REFUSED},
    {"export materialx", "small.session -o materialx", AGAIN_REFUSED},
    {"export usd", "small.session -o usd", AGAIN_REFUSED},
    {"export blender", "small.session -o blender", AGAIN_REFUSED},
    {"export bsdf", "small.session --isotropic -o small.bsdf", AGAIN_STAYS},
    {"export merl", "small.session -o small.binary", AGAIN_STAYS},
    {"import utia", "grey.bin -d few.csv -o utia.session", AGAIN_STAYS},
    /* The training of the neural planes takes a third as long for a session of one texel. */
    {"compare", "utia.session --curve curve.svg", AGAIN_OWN},
    {"export ptm", "utia.session -o grey.ptm --view 0", AGAIN_REFUSED},
    {"export relight", "utia.session -o grey --view 0", AGAIN_REFUSED},
    {"import btf", "small.btf -o btf.session", AGAIN_STAYS},
    {"import bsdf", "small.bsdf -d few.csv -o bsdf.session", AGAIN_STAYS},
    {"import merl", "small.binary -d few.csv -o merl.session", AGAIN_STAYS},
    {"import ptm", "grey.ptm -o ptm.session", AGAIN_STAYS},
    {"import relight", "grey -o relight.session", AGAIN_STAYS},
    {"import pictures", "maps -o pictures.session", .code = 1},
    {"import rti", "lights.lp -o rti.session", .code = 1},
    {"import poses", "poses.csv --template -o nominal.conf", AGAIN_REFUSED},
    {"calibrate radiometry", "small.session --reflectance 0.5 --tile 40.5x40.5 -o tile.conf",
     .code = 1},
    {"calibrate cameras", "small.session --board 8x8,square=9.5,marker=6.75 -o cameras.conf",
     .code = 1},
    {"calibrate laser", "small.session small.session --planes 1.5;2.5 -o laser.conf", .code = 1},
    {"calibrate lights", "small.session --target " SOURCE_DIR "/etc/demo/poles.conf -o lights.conf",
     .code = 1},
    {"calibrate colour", "small.session --chart chart.csv -o colour.conf", .code = 1},
    {"calibrate show", "rig.calibration"},
    {"calibrate report", "rig.calibration -o calibration.html", AGAIN_OWN},
    /* With a daemon. */
    {"status", ""},
    {"snap", "cam30 --lamp lamp30 -e 2500 -o snap.png", AGAIN_OWN},
    {"snap", "cam30 --lamp lamp30 -e 2500 -o snap.exr", AGAIN_OWN},
    {"live", "cam30 -n 1"},
    {"lamp", "lamp30 --for 0.25"},
    {"laser", "laser30 --for 0.25"},
    {"home", "turntable"},
    {"move", "turntable 12.5"},
    {"test", ""},
    {"test", "--report test.html", AGAIN_OWN},
    {"test", "--record test.rec", AGAIN_OWN},
    {"queue list", ""},
    {"queue pause", ""},
    {"queue add", "session.conf -o queued.session --yes"},
    {"queue move", "1 1"},
    {"queue remove", "1"},
    {"queue resume", ""},
    {"pause", "", .code = 1},
    {"continue", "", .code = 1},
    {"watch", "--no-pictures"},
    {"finish", "", .code = 1},
    {"abort", "", .code = 1},
    {"safe", ""},
    {"release", ""},
    {"close", ""},
    /* Other programs. */
    {"../mesorig-view", "small.session --render view.png --size 40x30 --light-theta-deg 12.5",
     AGAIN_OWN},
    {"../mesorig-view",
     "small.session --render light.exr --size 40x30 --light-brightness 0.5 --json", AGAIN_OWN},
    {"../mesorig-trace",
     "scene.gltf -o trace.png --exr trace.exr --lamp 12.5,0.5 --size 20x15 --samples 2 --json",
     AGAIN_OWN},
    {"../mesorig-compress-mpi", "small.session -o parts.exr -k 2 --components 3 --json", AGAIN_OWN},
};

struct place {
    const char *name;
    char *folder;
    gboolean refuses; /* by tests/lib/refusing.h, where there is no FUSE */
    GSubprocess *daemon;
    char *out; /* of the last call: standard output, then errors */
    int code;
};

static char *top, *self;

static char *place_path(const struct place *place, const char *name) {
    return g_build_filename(place->folder, name, NULL);
}

static void put(const struct place *place, const char *name, const void *bytes, gssize n) {
    g_autofree char *path = place_path(place, name);
    ok(g_file_set_contents(path, bytes, n, ERR));
}

/* Runs a program in the folder. arguments: with blanks between them; further: NULL, or one more. */
static void place_runs(struct place *place, const char *program, const char *arguments,
                       const char *further) {
    g_auto(GStrv) words = g_strsplit(arguments, " ", -1);
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_autofree char *out = NULL, *err = NULL;
    int status = 0;
    g_auto(GStrv) environment = g_get_environ();
    if (g_str_has_suffix(program, "-mpi")) /* MPI leaks, in modules that it has unloaded */
        environment = g_environ_setenv(environment, "ASAN_OPTIONS", "detect_leaks=0", TRUE);
    if (place->refuses) {
        g_ptr_array_add(argv, self);
        g_ptr_array_add(argv, (gpointer) "--refusing");
    }
    g_ptr_array_add(argv, (gpointer)program);
    for (char **word = words; *word; word++)
        if (**word)
            g_ptr_array_add(argv, *word);
    if (further)
        g_ptr_array_add(argv, (gpointer)further);
    g_ptr_array_add(argv, NULL);
    ok(g_spawn_sync(place->folder, (char **)argv->pdata, environment, G_SPAWN_SEARCH_PATH, NULL,
                    NULL, &out, &err, &status, ERR));
    g_free(place->out);
    place->out = g_strconcat(out, err, NULL);
    place->code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    g_test_message("%s: %s %s %s: %d", place->name, program, arguments, further ? further : "",
                   place->code);
}

static void place_says(const struct place *place, const struct call_case *call, int code,
                       const char *words) {
    if (place->code != code || (words && !strstr(place->out, words))) {
        g_test_fail();
        g_printerr("%s: %s %s: exit code %d, not %d, or no “%s” in:\n%s\n", place->name,
                   call->command, call->arguments, place->code, code, words ? words : "",
                   place->out);
    }
}

/* Each line that looks like JSON is JSON, and no number has a decimal comma. */
static void check_json(const struct place *place, const struct call_case *call) {
    g_auto(GStrv) lines = g_strsplit(place->out, "\n", -1);
    int n = 0;
    for (char **line = lines; *line; line++) {
        g_autoptr(JsonParser) parser = json_parser_new();
        g_autoptr(GError) error = NULL;
        if (**line != '{' && **line != '[')
            continue;
        json_parser_load_from_data(parser, *line, -1, &error);
        if (error || g_regex_match_simple("[:\\[ ][0-9]+,[0-9]", *line, 0, 0))
            g_error("%s: %s: %s in %s", place->name, call->command,
                    error ? error->message : "a decimal comma", *line);
        n++;
    }
    place_says(place, call, n > 0 ? place->code : -2, NULL);
}

static void place_calls(struct place *place, const struct call_case *call) {
    const gboolean program = g_str_has_prefix(call->command, "../");
    g_autofree char *path =
        program ? g_strconcat(BIN, call->command + 3, NULL) : g_strdup(BIN "mesorig");
    g_autofree char *arguments = program ? g_strdup(call->arguments)
                                         : g_strconcat(call->command, " ", call->arguments, NULL);
    const gboolean json = !program || strstr(arguments, "--json");
    place_runs(place, path, arguments, program ? NULL : "--json");
    place_says(place, call, call->code, NULL);
    if (json && call->code == 0)
        check_json(place, call);
    if (call->again == AGAIN_NOTHING)
        return;
    place_runs(place, path, arguments, NULL);
    if (call->again == AGAIN_OWN)
        place_says(place, call, 0, json && program ? "replace" : "replaces");
    else
        place_says(place, call, 1, "exists already");
    if (call->again == AGAIN_REFUSED) {
        place_runs(place, path, arguments, "--force");
        place_says(place, call, 0, NULL);
    }
}

static void place_begin_daemon(struct place *place) {
    g_autofree char *address = g_strdup_printf("unix:path=%s/%s.bus", top, place->name);
    g_autofree char *listen = g_strconcat("--listen=", address, NULL);
    g_autofree char *log = g_strdup_printf("%s/%s.log", top, place->name);
    g_autofree char *queue = place_path(place, "queue.conf");
    g_autofree char *queue_option = g_strconcat("--queue=", queue, NULL);
    g_autofree char *rig = place_path(place, "rig.conf");
    g_autofree char *rig_option = g_strconcat("--rig=", rig, NULL);
    const char *const plain[] = {BIN "mesorigd", listen, queue_option, rig_option, NULL};
    const char *const bare[] = {self,       "--refusing", BIN "mesorigd", listen, queue_option,
                                rig_option, NULL};
    place->daemon =
        process_start_ready(G_SUBPROCESS_FLAGS_STDOUT_SILENCE, log, place->refuses ? bare : plain);
    g_setenv("MESORIG_ADDRESS", address, TRUE);
}

static void place_end_daemon(struct place *place) {
    g_subprocess_send_signal(place->daemon, SIGTERM);
    g_subprocess_wait(place->daemon, NULL, NULL);
    g_clear_object(&place->daemon);
    g_unsetenv("MESORIG_ADDRESS");
}

/* A calibration of the small rig, as if its cameras had been found again. */
static void place_calibrate(const struct place *place) {
    g_autofree char *rig_path = place_path(place, "rig.conf");
    g_autofree char *path = place_path(place, "rig.calibration");
    g_autoptr(GError) error = NULL;
    struct rig rig;
    g_assert_true(devices_read_geometry(rig_path, &rig, &error));
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "a test", 7, "abc", NULL);
    g_assert_true(calibration_write(calibration, path, &error));
}

/* What the calls need next to the small rig: a grey BRDF of UTIA's, a table, and a scene. */
static void place_fill(const struct place *place) {
    static const struct change changes[] = {
        {"[laser laser30]", "warm_up_ms = 250"}, {"[sample]", "texels = 16"}, {0}};
    const gsize n = 3 * (gsize)288 * 288;
    g_autofree double *grey = g_new(double, n);
    for (gsize i = 0; i < n; i++)
        grey[i] = 0.25;
    small_rig_write(place->folder, "rig.conf", changes);
    small_rig_write(place->folder, "world.conf", NULL);
    small_rig_write(place->folder, "session.conf", changes);
    put(place, "grey.bin", grey, (gssize)(n * sizeof *grey));
    put(place, "lights.lp", "none\n", -1);
    put(place, "few.csv",
        "of,theta_deg,phi_deg\nview,0,0\nlight,30.5,0\nlight,30.5,90\nlight,30.5,180\n"
        "light,30.5,270\nlight,60,45\nlight,60,135\nlight,60,225\nlight,60,315\n",
        -1);
    put(place, "chart.csv", "x_mm,y_mm,radius_mm,X,Y,Z\n1.5,2.5,1.5,0.25,0.25,0.25\n", -1);
    put(place, "poses.csv",
        "file,camera,lamp,turntable_deg,arc_deg,exposure_ms\nboard.png,near,left,12.5,0,1.5\n", -1);
    place_calibrate(place);
    g_autoptr(Mesh) sphere = scene_sphere();
    const struct trace_object object = {sphere, 0, 1.0F, {0, 0, 1}, FALSE};
    g_autofree char *scene = trace_fixture_text(&object, 1, "{\"name\": \"cloth\"}", "", "", 0);
    put(place, "scene.gltf", scene, -1);
}

/* The virtual devices' rig file: it appears, goes when they end, and stays if somebody has written
 * into it; the user's own one is never touched. */
static void place_virtual_rig(struct place *place) {
    const struct call_case call = {"../mesorig-rig", "--virtual rig.conf -o rig.conf --force"};
    g_autofree char *rig = place_path(place, "rig.conf"), *before = NULL, *after = NULL;
    g_autofree char *path = place_path(place, "virtual.conf");
    g_assert_true(g_file_get_contents(rig, &before, NULL, NULL));
    place_runs(place, BIN "mesorig-rig", call.arguments, NULL);
    place_says(place, &call, 1, "is also the file of --virtual");
    g_assert_true(g_file_get_contents(rig, &after, NULL, NULL));
    g_assert_cmpstr(before, ==, after);
    for (int changes = 0; changes < 2; changes++) {
        const char *const plain[] = {BIN "mesorig-rig", "--virtual", rig, "-o", path, NULL};
        const char *const bare[] = {self, "--refusing", BIN "mesorig-rig", "--virtual", rig, "-o",
                                    path, NULL};
        g_autoptr(GSubprocess) devices =
            process_start(G_SUBPROCESS_FLAGS_STDOUT_PIPE, NULL, place->refuses ? bare : plain);
        g_autoptr(GDataInputStream) in =
            g_data_input_stream_new(g_subprocess_get_stdout_pipe(devices));
        g_autofree char *line = g_data_input_stream_read_line(in, NULL, NULL, NULL);
        g_autofree char *text = NULL;
        g_assert_nonnull(line);
        g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
        assert_has(text, "\nwarm_up_s = 0.25\n");
        g_assert_false(g_regex_match_simple("^\\w+ = [0-9]+,[0-9]", text, G_REGEX_MULTILINE, 0));
        g_autofree char *edited = g_strconcat(text, "\ncalibration = own.conf\n", NULL);
        if (changes)
            put(place, "virtual.conf", edited, -1);
        g_subprocess_send_signal(devices, SIGTERM);
        g_assert_true(g_subprocess_wait_check(devices, NULL, NULL));
        g_autofree char *left = NULL;
        g_assert_cmpint(g_file_get_contents(path, &left, NULL, NULL), ==, changes);
        if (changes)
            g_assert_cmpstr(left, ==, edited);
    }
    place_runs(place, BIN "mesorig-rig", "--virtual rig.conf -o virtual.conf", NULL);
    place_says(place, &call, 1, "virtual.conf exists already");
}

static void place_run_all(struct place *place) {
    gboolean with_daemon = FALSE;
    place_fill(place);
    for (gsize i = 0; i < G_N_ELEMENTS(calls); i++) {
        const gboolean begins = g_str_equal(calls[i].command, "status");
        if (begins)
            place_begin_daemon(place);
        with_daemon |= begins;
        place_calls(place, &calls[i]);
        if (with_daemon && g_str_equal(calls[i].command, "close")) {
            place_end_daemon(place);
            with_daemon = FALSE;
        }
    }
    place_virtual_rig(place);
    /* Nothing unfinished is left. */
    g_autoptr(GDir) dir = g_dir_open(place->folder, 0, NULL);
    for (const char *name; (name = g_dir_read_name(dir));)
        if (strstr(name, ".part") || strstr(name, ".lock") || *name == '.')
            g_error("%s: %s is left", place->name, name);
}

/* Files that are the same in any place and at any time. */
static const char *const same[] = {
    "plan.svg",     "energy.svg", "hsh.exr",        "distances.exr", "compared.svg", "index.exr",
    "board.svg",    "board.png",  "small.btf",      "points.ply",    "mesh.ply",     "height.exr",
    "normals.exr",  "page.html",  "page.mesoweb",   "small.glb",     "text.gltf",    "small.bsdf",
    "small.binary", "grey.ptm",   "grey/info.json", "view.png",      "light.exr",    "trace.png",
    "trace.exr",    "parts.exr"};

static void places_agree(const struct place *a, const struct place *b) {
    for (gsize i = 0; i < G_N_ELEMENTS(same); i++) {
        g_autofree char *first = place_path(a, same[i]), *second = place_path(b, same[i]);
        g_autofree char *one = NULL, *other = NULL;
        gsize n = 0, m = 0;
        if (!g_file_get_contents(first, &one, &n, NULL) ||
            !g_file_get_contents(second, &other, &m, NULL) || n != m || memcmp(one, other, n) != 0)
            g_error("%s differs between %s and %s, %zu and %zu bytes", same[i], a->name, b->name, n,
                    m);
    }
}

static struct place place_new(const char *name) {
    struct place place = {.name = name, .folder = g_build_filename(top, name, NULL)};
    g_assert_cmpint(g_mkdir(place.folder, 0777), ==, 0);
    return place;
}

static void place_clear(struct place *place) {
    g_free(place->folder);
    g_free(place->out);
}

static struct place ordinary;

TEST(ordinary) {
    ordinary = place_new("ordinary");
    place_run_all(&ordinary);
}

/* Every command is in the list, so that a new one cannot be left out. */
static void note_missing(const struct command *const *commands) {
    for (; *commands; commands++) {
        gboolean found = FALSE;
        for (gsize i = 0; i < G_N_ELEMENTS(calls); i++)
            found |= g_str_equal(calls[i].command, (*commands)->name);
        if (!found && !(*commands)->children)
            g_error("%s is called nowhere in this test", (*commands)->name);
        if ((*commands)->children)
            note_missing((*commands)->children);
    }
}

TEST(all) {
    note_missing(cli_commands());
}

/* bindfs is FUSE without RENAME_NOREPLACE and fallocate(). */
TEST(fuse) {
    g_autofree char *below = g_build_filename(top, "below", NULL);
    struct place place = place_new("fuse");
    const char *const mounts[] = {"bindfs", "--no-allow-other", below, place.folder, NULL};
    const gboolean fuse = access("/dev/fuse", R_OK | W_OK) == 0;
    g_assert_cmpint(g_mkdir(below, 0777), ==, 0);
    if (fuse)
        g_free(process_text(0, mounts));
    else
        place.refuses = TRUE;
    g_test_message("%s", fuse ? "on FUSE (bindfs)" : "without /dev/fuse: refused by seccomp");
    if (fuse) { /* it is what it is said to be */
        g_autofree char *from = place_path(&place, "from"), *to = place_path(&place, "to");
        g_assert_true(g_file_set_contents(from, "x", 1, NULL));
        g_assert_cmpint(renameat2(AT_FDCWD, from, AT_FDCWD, to, RENAME_NOREPLACE), ==, -1);
        g_assert_cmpint(errno, ==, EINVAL);
        g_assert_cmpint(g_unlink(from), ==, 0);
    }
    place_run_all(&place);
    if (ordinary.folder) /* else that test was left out */
        places_agree(&ordinary, &place);
    if (fuse) {
        const char *const unmounts[] = {"fusermount3", "-u", place.folder, NULL};
        g_free(process_text(0, unmounts));
    }
    place_clear(&place);
}

TEST(comma) {
    g_autofree char *locale = g_build_filename(top, "locale", NULL);
    g_autofree char *german = g_build_filename(locale, "de_DE.UTF-8", NULL);
    const char *const makes[] = {"localedef", "-i", "de_DE", "-f", "UTF-8", german, NULL};
    const char *const asks[] = {"locale", "decimal_point", NULL};
    struct place place = place_new("comma");
    g_assert_cmpint(g_mkdir(locale, 0777), ==, 0);
    g_free(process_text(0, makes));
    g_setenv("LOCPATH", locale, TRUE);
    g_setenv("LC_ALL", "de_DE.UTF-8", TRUE);
    g_autofree char *point = process_text(0, asks);
    g_assert_cmpstr(point, ==, ",\n");
    place_run_all(&place);
    if (ordinary.folder) /* else that test was left out */
        places_agree(&ordinary, &place);
    g_unsetenv("LOCPATH");
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    place_clear(&place);
}

BEFORE_TESTS {
    self = g_file_read_link("/proc/self/exe", NULL);
    top = g_dir_make_tmp("mesorig-every-XXXXXX", NULL);
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    /* Whatever else runs on this machine is none of ours. */
    g_setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("DBUS_SESSION_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("XDG_RUNTIME_DIR", top, TRUE);
    g_unsetenv("MESORIG_ADDRESS");
}

AFTER_TESTS {
    place_clear(&ordinary);
    remove_tree(top);
    g_free(top);
    g_free(self);
}

int main(int argc, char **argv) {
    if (argc > 2 && g_str_equal(argv[1], "--refusing")) {
        refusing_begin(FALSE);
        execv(argv[2], argv + 2);
        return 127;
    }
    return tests_run(argc, argv);
}
