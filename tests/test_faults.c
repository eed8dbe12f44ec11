/* What the operator sees: mesorig runs sessions of the small rig with every fault it can have, is
 * told what is wrong, and goes on when that is mended. The products are those of a session that
 * nothing happened to. */
#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/statvfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/json.h"
#include "long_session.h"
#include "processing/session.h"

#define SMALL   SOURCE_DIR "/tests/small/"
#define MESORIG BUILD_DIR "/bin/mesorig"
#define DAEMON  BUILD_DIR "/bin/mesorigd"

/* A line put below a section's head, in place of one for the same key. */
struct change {
    const char *head, *line;
};

#define MOST_CHANGES 5

struct run {
    char *directory, *rig, *conf, *session;
    char *out, *err; /* of the last command */
};

static char *top;
static int n_made;

static void remove_tree(const char *path) {
    const char *const argv[] = {"/bin/rm", "-rf", path, NULL};
    g_spawn_sync(NULL, (char **)argv, NULL, 0, NULL, NULL, NULL, NULL, NULL, NULL);
}

static char *read_file(const char *path) {
    g_autoptr(GError) error = NULL;
    char *text = NULL;
    g_file_get_contents(path, &text, NULL, &error);
    g_assert_no_error(error);
    return text;
}

static void write_file(const char *path, const char *text, gssize length) {
    g_autoptr(GError) error = NULL;
    g_file_set_contents(path, text, length, &error);
    g_assert_no_error(error);
}

/* line NULL: the whole section goes. */
static char *changed_text(const char *text, const struct change *change) {
    GString *to = g_string_new(NULL);
    gboolean inside = FALSE;
    g_autofree char *key =
        change->line ? g_strndup(change->line, strcspn(change->line, " =")) : NULL;
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    g_assert_nonnull(strstr(text, change->head));
    for (char **line = lines; *line; line++) {
        g_autofree char *its = g_strndup(*line, strcspn(*line, " ="));
        if (**line == '[')
            inside = g_str_equal(*line, change->head);
        if (inside && (!key || g_str_equal(its, key)))
            continue;
        g_string_append_printf(to, "%s\n", *line);
        if (inside && **line == '[')
            g_string_append_printf(to, "%s\n", change->line);
    }
    return g_string_free(to, FALSE);
}

static void write_changed(const struct run *run, const char *name, const struct change *changes) {
    g_autofree char *from = g_strconcat(SMALL, name, NULL);
    g_autofree char *to = g_build_filename(run->directory, name, NULL);
    g_autofree char *text = read_file(from);
    for (int i = 0; changes && i < MOST_CHANGES && changes[i].head; i++) {
        char *changed = changed_text(text, &changes[i]);
        g_free(text);
        text = changed;
    }
    write_file(to, text, -1);
}

static struct run *run_new_in(const char *parent, const struct change *rig_changes) {
    struct run *run = g_new0(struct run, 1);
    run->directory = g_strdup_printf("%s/%d", parent, n_made++);
    run->rig = g_build_filename(run->directory, "rig.conf", NULL);
    run->conf = g_build_filename(run->directory, "session.conf", NULL);
    run->session = g_build_filename(run->directory, "small.session", NULL);
    g_assert_cmpint(g_mkdir(run->directory, 0777), ==, 0);
    write_changed(run, "rig.conf", rig_changes);
    write_changed(run, "world.conf", NULL);
    write_changed(run, "session.conf", NULL);
    return run;
}

static struct run *run_new(const struct change *rig_changes) {
    return run_new_in(top, rig_changes);
}

static void run_free(struct run *run) {
    remove_tree(run->directory);
    g_free(run->directory);
    g_free(run->rig);
    g_free(run->conf);
    g_free(run->session);
    g_free(run->out);
    g_free(run->err);
    g_free(run);
}

static void does(struct run *run, int code, ...) G_GNUC_NULL_TERMINATED;

/* Runs mesorig with arguments up to NULL, and asks for its exit code. */
static void does(struct run *run, int code, ...) {
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_autoptr(GError) error = NULL;
    int status = -1;
    va_list arguments;
    g_ptr_array_add(argv, (char *)MESORIG);
    va_start(arguments, code);
    for (char *argument; (argument = va_arg(arguments, char *));)
        g_ptr_array_add(argv, argument);
    va_end(arguments);
    g_ptr_array_add(argv, NULL);
    g_clear_pointer(&run->out, g_free);
    g_clear_pointer(&run->err, g_free);
    g_spawn_sync(NULL, (char **)argv->pdata, NULL, 0, NULL, NULL, &run->out, &run->err, &status,
                 &error);
    g_assert_no_error(error);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != code)
        g_error("mesorig %s: exit status %x, not %d\n%s%s", (char *)argv->pdata[1], status, code,
                run->out, run->err);
}

static void capture(struct run *run, int code) {
    does(run, code, "capture", run->rig, run->conf, "-o", run->session, NULL);
}

static void assert_has(const char *text, const char *words) {
    if (!text || !strstr(text, words))
        g_error("no “%s” in: %s", words, text);
}

static int by_text(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* Every product's name and checksum, a line each. */
static char *products_of(const char *session) {
    static const char *const folders[] = {"products", "products/btf"};
    g_autoptr(GPtrArray) lines = g_ptr_array_new_with_free_func(g_free);
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *folder = g_build_filename(session, folders[i], NULL);
        g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
        const char *name;
        while (dir && (name = g_dir_read_name(dir))) {
            g_autofree char *path = g_build_filename(folder, name, NULL);
            g_autofree char *data = NULL;
            gsize length = 0;
            if (!g_str_has_suffix(name, ".exr"))
                continue;
            g_assert_true(g_file_get_contents(path, &data, &length, NULL));
            g_autofree char *sum =
                g_compute_checksum_for_data(G_CHECKSUM_SHA256, (guchar *)data, length);
            g_ptr_array_add(lines, g_strdup_printf("%s/%s %s", folders[i], name, sum));
        }
    }
    g_ptr_array_sort(lines, by_text);
    g_ptr_array_add(lines, NULL);
    return g_strjoinv("\n", (char **)lines->pdata);
}

/* The products of a session that nothing happens to. */
static const char *undisturbed(void) {
    static char *products;
    if (products)
        return products;
    struct run *run = run_new(NULL);
    capture(run, 0);
    assert_has(run->out, "no retakes");
    does(run, 0, "process", run->session, NULL);
    products = products_of(run->session);
    assert_has(products, "products/mdf.exr");
    assert_has(products, "products/eigenmaps.exr");
    assert_has(products, "products/btf/view_0003.exr");
    run_free(run);
    return products;
}

static void check_products(struct run *run) {
    does(run, 0, "process", run->session, NULL);
    g_autofree char *products = products_of(run->session);
    g_assert_cmpstr(products, ==, undisturbed());
}

/* What the database has of the frames, a line each. */
static char *frames_of(const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    g_assert_no_error(error);
    GString *text = g_string_new(NULL);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_autofree char *file = g_build_filename(path, frame->path, NULL);
        g_assert_true(g_file_test(file, G_FILE_TEST_IS_REGULAR));
        g_string_append_printf(text, "%s %s %.6f %d\n", frame->path, frame->sha256,
                               frame->captured_s, frame->retakes);
    }
    return g_string_free(text, FALSE);
}

static gboolean has_event(const char *path, const char *level, const char *source,
                          const char *message) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) events = session_events(session, &error);
    g_assert_no_error(error);
    for (guint i = 0; i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        if (g_str_equal(event->level, level) && g_str_equal(event->source, source) &&
            g_str_equal(event->message, message))
            return TRUE;
    }
    return FALSE;
}

static char *between(const char *text, const char *from, const char *to) {
    const char *at = strstr(text, from);
    g_assert_nonnull(at);
    at += strlen(from);
    g_assert_nonnull(strstr(at, to));
    return g_strndup(at, (gsize)(strstr(at, to) - at));
}

static gboolean begins_with(const char *text, const char *start) {
    return strncmp(text, start, strlen(start)) == 0;
}

/* After a capture that ended with a fault: the terminal, the session's state, its events and what
 * can be asked of it all tell the same. */
static void check_told(struct run *run, const char *device, const char *happened,
                       const char *to_do) {
    g_autofree char *told = g_strdup_printf("error: %s: ", device);
    g_autofree char *go_on = g_strdup_printf("to go on: mesorig resume %s\n", run->session);
    assert_has(run->out, told);
    assert_has(run->err, go_on);
    g_autofree char *reason = between(run->err, "mesorig: paused", "\n");
    const gboolean is_safe = begins_with(reason, ", the rig is safe: ");
    memmove(reason, strstr(reason, ": ") + 2, strlen(strstr(reason, ": ") + 2) + 1);
    g_assert_true(is_safe == !strstr(reason, "THE RIG COULD NOT BE MADE SAFE"));
    assert_has(reason, device);
    assert_has(reason, happened);
    assert_has(reason, to_do);
    assert_has(reason, "then go on.");
    g_assert_true(has_event(run->session, "error", device, reason));
    g_autoptr(GString) json = g_string_new("\"state\": \"paused\", \"reason\": ");
    json_append_string(json, reason);
    const char *in_json = json->str;
    does(run, 0, "status", "--json", run->session, NULL);
    assert_has(run->out, in_json);
    does(run, 0, "info", "--json", run->session, NULL);
    assert_has(run->out, in_json);
    does(run, 0, "status", run->session, NULL);
    assert_has(run->out, "state      paused\n");
    assert_has(run->out, reason);
    assert_has(run->out, "mesorig resume");
    does(run, 1, "process", run->session, NULL);
    assert_has(run->err, "frames of");
    assert_has(run->err, "mesorig resume");
}

struct fault {
    const char *name; /* of the test */
    struct change changes[MOST_CHANGES];
    const char *device, *happened, *to_do;
    gboolean lasts; /* as long as it is not mended, a resumed session is paused too */
};

static const struct fault faults[] = {
    {"stale-old",
     {{"[camera cam60]", "fault_stale = 1"}},
     "cam60",
     "no good picture in 4 attempts; the last time: picture refused: it is an old one",
     "Switch it off and on again",
     TRUE},
    {"stale-relabelled",
     {{"[camera cam30]", "fault_stale = 1"}, {"[camera cam30]", "fault_stale_kind = relabelled"}},
     "cam30",
     "it repeats the picture of shot",
     "Switch it off and on again",
     TRUE},
    {"lost",
     {{"[camera cam60]", "fault_lost = 1"}},
     "cam60",
     "no picture 2.1 s after its trigger",
     "check its cable",
     TRUE},
    {"slow",
     {{"[camera cam30]", "fault_slow_ms = 60000"}},
     "cam30",
     "4 attempts",
     "check its cable",
     TRUE},
    {"gone",
     {{"[camera cam60]", "fault_disconnect_after = 30"},
      {"[camera cam60]", "fault_reconnect_s = 3000"}},
     "cam60",
     "it is gone",
     "check its cable",
     FALSE},
    {"turntable-stalls",
     {{"[axis turntable]", "fault_stall_at = 2"}},
     "turntable",
     "stalled at",
     "see what blocks it",
     FALSE},
    {"turntable-is-silent",
     {{"[axis turntable]", "fault_stall_at = 1"},
      {"[axis turntable]", "fault_stall_kind = silent"}},
     "turntable",
     "still moving at its deadline",
     "check drive and cable",
     FALSE},
    {"arc-stalls",
     {{"[axis arc]", "fault_stall_at = 1"}},
     "arc",
     "stalled at",
     "see what blocks it",
     TRUE},
    {"arc-is-silent",
     {{"[axis arc]", "fault_stall_at = 2"}, {"[axis arc]", "fault_stall_kind = silent"}},
     "arc",
     "still moving at its deadline",
     "check drive and cable",
     FALSE},
    {"sweep-stalls",
     {{"[axis sweep60]", "fault_stall_at = 7"}},
     "sweep60",
     "stalled at",
     "see what blocks it",
     FALSE},
    {"sweep-is-silent",
     {{"[axis sweep30]", "fault_stall_at = 9"}, {"[axis sweep30]", "fault_stall_kind = silent"}},
     "sweep30",
     "still moving at its deadline",
     "check drive and cable",
     FALSE},
    {"lamp-is-dead",
     {{"[lamps bank]", "fault_dead = lamp60"}},
     "lamp60",
     "gives no light",
     "Check the lamp, its fuse and its relay",
     TRUE},
    {"lamp-dies",
     {{"[lamps bank]", "fault_dead = lamp30"}, {"[lamps bank]", "fault_dead_after = 2"}},
     "lamp30",
     "gives no light",
     "Check the lamp, its fuse and its relay",
     FALSE},
    {"laser-stays-on",
     {{"[laser laser30]", "fault_stays_on = yes"}},
     "laser30",
     "stays on",
     "Cut its power, check its relay",
     TRUE},
    {"laser-is-deaf",
     {{"[laser laser60]", "fault_deaf = 1000"}},
     "laser60",
     "THE RIG COULD NOT BE MADE SAFE: laser laser60: did not answer to \"off\"",
     "it may still shine: cut its power by hand",
     TRUE},
    {"door-opens-while-homing",
     {{"[interlock door]", "open_after_s = 1"}},
     "door",
     "is open: laser and motion are forbidden",
     "Close it",
     TRUE},
    {"door-opens",
     {{"[interlock door]", "open_after_s = 9"}},
     "door",
     "is open: laser and motion are forbidden",
     "Close it",
     FALSE},
};

static void test_fault(gconstpointer data) {
    const struct fault *fault = data;
    struct run *run = run_new(fault->changes);
    capture(run, 1);
    check_told(run, fault->device, fault->happened, fault->to_do);
    g_autofree char *before = frames_of(run->session);
    if (fault->lasts) {
        does(run, 1, "resume", run->session, NULL);
        check_told(run, fault->device, fault->happened, fault->to_do);
    }
    g_autofree char *still = frames_of(run->session);
    g_assert_true(begins_with(still, before));
    write_changed(run, "rig.conf", NULL); /* mended */
    if (fault->lasts) {
        g_autofree char *mended = g_build_filename(run->directory, "mended.conf", NULL);
        g_assert_cmpint(g_rename(run->rig, mended), ==, 0);
        does(run, 0, "resume", "--rig", mended, run->session, NULL);
    } else {
        does(run, 0, "resume", run->session, NULL);
    }
    assert_has(run->out, "done: 13 of 13 shots");
    g_autofree char *after = frames_of(run->session);
    g_assert_true(begins_with(after, still));
    does(run, 0, "status", "--json", run->session, NULL);
    assert_has(run->out, "\"state\": \"done\", \"reason\": \"\"");
    check_products(run);
    run_free(run);
}

/* Faults that pass: the session ends by itself. */
static const struct fault passing[] = {
    {"some-stale-old",
     {{"[camera cam30]", "fault_stale = 0.05"},
      {"[camera cam60]", "fault_stale = 0.05"},
      {"[camera cam60]", "fault_seed = 7"}},
     "cam60",
     "it is an old one",
     NULL,
     FALSE},
    {"some-stale-relabelled",
     {{"[camera cam30]", "fault_stale = 0.05"},
      {"[camera cam30]", "fault_stale_kind = relabelled"},
      {"[camera cam60]", "fault_stale = 0.05"},
      {"[camera cam60]", "fault_stale_kind = relabelled"},
      {"[camera cam60]", "fault_seed = 7"}},
     "cam60",
     "it repeats the picture",
     NULL,
     FALSE},
    {"some-lost",
     {{"[camera cam60]", "fault_lost = 0.05"}},
     "cam60",
     "no picture 2.1 s after its trigger",
     NULL,
     FALSE},
    {"gone-for-a-moment",
     {{"[camera cam60]", "fault_disconnect_after = 30"}},
     "cam60",
     "it is gone; check its cable",
     NULL,
     FALSE},
    {"rather-slow", {{"[camera cam30]", "fault_slow_ms = 300"}}, NULL, NULL, NULL, FALSE},
};

static void test_passing(gconstpointer data) {
    const struct fault *fault = data;
    struct run *run = run_new(fault->changes);
    capture(run, 0);
    assert_has(run->out, "done: 13 of 13 shots");
    if (fault->device) {
        g_autofree char *told =
            g_strdup_printf("warning: %s: picture taken again: ", fault->device);
        assert_has(run->out, told);
        assert_has(run->out, fault->happened);
        g_assert_null(strstr(run->out, "done, no retakes"));
        does(run, 0, "info", "--json", run->session, NULL);
        g_assert_null(strstr(run->out, "\"retakes\": 0,"));
        assert_has(run->out, fault->happened);
    } else {
        assert_has(run->out, "no retakes");
    }
    check_products(run);
    run_free(run);
}

/* The door of a rig whose daemon stays: it says so as long as it is asked, refuses to go on while
 * the door is open, and goes on when it is shut. */
static void test_daemon_stays(void) {
    struct run *run = run_new((const struct change[]){
        {"[interlock door]", "open_after_s = 9"}, {"[interlock door]", "open_for_s = 60"}, {0}});
    g_autoptr(GError) error = NULL;
    g_autofree char *socket = g_build_filename(run->directory, "bus", NULL);
    g_autofree char *listen = g_strdup_printf("unix:path=%s", socket);
    g_autofree char *address = g_strdup_printf("--address=%s", listen);
    g_autoptr(GSubprocess) daemon = g_subprocess_new(G_SUBPROCESS_FLAGS_STDERR_SILENCE, &error,
                                                     DAEMON, "--listen", listen, NULL);
    g_assert_no_error(error);
    for (int i = 0; i < 3000 && !g_file_test(socket, G_FILE_TEST_EXISTS); i++)
        g_usleep(10000);
    does(run, 1, "capture", address, run->rig, run->conf, "-o", run->session, NULL);
    assert_has(run->out, "error: door: interlock door is open");
    assert_has(run->err, "mesorig: paused, the rig is safe: interlock door is open");
    assert_has(run->err, "to go on: mesorig continue ");
    does(run, 0, "status", "--json", address, NULL);
    assert_has(run->out, "\"state\": \"paused\", \"reason\": \"interlock door is open");
    assert_has(run->out, "[\"interlock\", \"door\", \"sim-interlock\", ");
    does(run, 0, "status", address, NULL);
    assert_has(run->out, "reason     interlock door is open");
    /* Simulated minutes take a moment. */
    g_usleep(100000);
    does(run, 0, "continue", run->session, NULL);
    does(run, 0, "watch", address, NULL);
    does(run, 0, "status", "--json", run->session, NULL);
    assert_has(run->out, "\"state\": \"done\"");
    g_subprocess_send_signal(daemon, SIGTERM);
    g_assert_true(g_subprocess_wait_check(daemon, NULL, &error));
    g_assert_no_error(error);
    check_products(run);
    run_free(run);
}

struct mistake {
    const char *file;
    struct change change;
    const char *place; /* what the message has after the file's path */
    const char *says;
};

static const struct mistake mistakes[] = {
    {"rig.conf",
     {"[axis turntable]", "setle_ms = 150"},
     ":10: [axis turntable] setle_ms",
     "settle_ms?"},
    {"rig.conf",
     {"[axis turntable]", "settle_s = 0.15"},
     ":10: [axis turntable] settle_s",
     "write settle_ms"},
    {"rig.conf",
     {"[axis turntable]", "speed_deg_s = -1"},
     ":10: [axis turntable] speed_deg_s",
     "0.001 to 100000 deg/s"},
    {"rig.conf",
     {"[axis turntable]", "speed_deg_s = NaN"},
     ":10: [axis turntable] speed_deg_s",
     "not a number"},
    {"rig.conf",
     {"[camera cam30]", "distance_mm = 650 mm"},
     " [camera cam30] distance_mm",
     "write the number alone"},
    {"rig.conf",
     {"[axis turntable]", NULL},
     ": there is no section [axis turntable]",
     "a rig needs"},
    {"rig.conf", {"[lamps bank]", NULL}, " [lamp lamp30] bank", "there is no section [lamps"},
    {"rig.conf", {"[lamp lamp30]", "bank = benk"}, " [lamp lamp30] bank", "[lamps benk]"},
    {"rig.conf", {"[camera cam30]", "width = 33"}, " [camera cam30] width", "write width = 32"},
    {"rig.conf",
     {"[interlock door]", "driver = steam"},
     " [interlock door] driver",
     "choose from: sim-interlock"},
    {"rig.conf", {"[axis arc]", "world = welt.conf"}, " [axis arc]: cannot read ", "welt.conf"},
    {"rig.conf",
     {"[axis arc]", "part = leg"},
     " [axis arc]: ",
     "choose turntable, arc or one of its lasers"},
    {"rig.conf",
     {"[lamps bank]", "fault_dead = lamp61"},
     " [lamps bank]: ",
     "has no lamp \"lamp61\""},
    {"session.conf",
     {"[views]", "rings = 30:2; 45:2"},
     ":13: [views]: no camera stands at elevation 45°",
     "there are: 30° (cam30), 60° (cam60)"},
    {"session.conf",
     {"[lights]", "rings = 10:2"},
     " [lights]: no lamp stands at elevation 10°",
     "lamp30"},
    {"session.conf",
     {"[lasers]", "rings = 45:1"},
     " [lasers]: no laser stands at elevation 45°",
     "laser60"},
    {"session.conf", {"[views]", NULL}, ": there is no section [views]", "[views]"},
    {"session.conf", {"[sample]", "texels = 100000"}, " [sample] texels", "0 to 8192"},
    {"session.conf",
     {"[capture]", "exposures_us = 4000; nan"},
     " [capture] exposures_us",
     "not a number"},
    {"session.conf",
     {"[capture]", "exposures_ms = 4; 16"},
     " [capture] exposures_ms",
     "write exposures_us"},
    {"session.conf", {"[capture]", "sweep_steps = 60000"}, " [capture] sweep_steps", "8 to 32767"},
    {"session.conf", {"[capture]", "dark_frames = 2.5"}, " [capture] dark_frames", "whole number"},
    {"world.conf", {"[world]", "gather_rays = nan"}, " [world] gather_rays", "whole number"},
};

/* A mistake in a file is told with its place and what would be right, before anything moves. */
static void test_mistakes(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(mistakes); i++) {
        const struct mistake *mistake = &mistakes[i];
        struct run *run = run_new(NULL);
        g_autofree char *path = g_build_filename(run->directory, mistake->file, NULL);
        write_changed(run, mistake->file, (const struct change[MOST_CHANGES]){mistake->change});
        does(run, 1, "plan", run->rig, run->conf, NULL);
        g_autofree char *planned = g_strdup(run->err);
        capture(run, 1);
        g_assert_cmpstr(run->err, ==, planned);
        assert_has(run->err, path);
        assert_has(run->err, mistake->place);
        assert_has(run->err, mistake->says);
        g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
        run_free(run);
    }
}

static const struct change late_death[MOST_CHANGES] = {{"[lamps bank]", "fault_dead = lamp60"},
                                                       {"[lamps bank]", "fault_dead_after = 2"}};

/* With the file of another rig a session is not resumed, and stays as it is. */
static void test_other_rig(void) {
    struct run *run = run_new(late_death);
    g_autofree char *other = g_build_filename(run->directory, "other.conf", NULL);
    capture(run, 1);
    g_autofree char *before = frames_of(run->session);
    write_changed(run, "rig.conf", (const struct change[MOST_CHANGES]){{"[rig]", "id = another"}});
    g_assert_cmpint(g_rename(run->rig, other), ==, 0);
    does(run, 1, "resume", "--rig", other, run->session, NULL);
    assert_has(run->err, "the session was begun on rig small, but this is rig another");
    assert_has(run->err, run->session);
    does(run, 1, "resume", run->session, NULL); /* its own is not there */
    assert_has(run->err, run->rig);
    assert_has(run->err, "--rig");
    g_autofree char *after = frames_of(run->session);
    g_assert_cmpstr(before, ==, after);
    write_changed(run, "rig.conf", NULL);
    does(run, 0, "resume", run->session, NULL);
    check_products(run);
    run_free(run);
}

static void test_garbage_database(void) {
    struct run *run = run_new(NULL);
    g_autofree char *database = g_build_filename(run->session, "session.db", NULL);
    g_autofree char *garbage = g_malloc(9000);
    for (int i = 0; i < 9000; i++)
        garbage[i] = (char)g_test_rand_int();
    g_assert_cmpint(g_mkdir(run->session, 0777), ==, 0);
    write_file(database, garbage, 9000);
    static const char *const commands[] = {"resume", "process", "info", "status"};
    for (gsize i = 0; i < G_N_ELEMENTS(commands); i++) {
        does(run, 1, commands[i], run->session, NULL);
        assert_has(run->err, database);
    }
    capture(run, 1);
    assert_has(run->err, "exists already; choose another name, or resume it");
    g_autofree char *after = NULL;
    gsize length = 0;
    g_assert_true(g_file_get_contents(database, &after, &length, NULL));
    g_assert_cmpmem(after, length, garbage, 9000);
    run_free(run);
}

/* A frame that was cut short or is gone: told by name, and mended by a resume. The views that do
 * not need it are made all the same. */
static void test_damaged_frames(void) {
    struct run *run = run_new(NULL);
    undisturbed();
    capture(run, 0);
    g_autofree char *frame = g_build_filename(run->session, "frames", "000003_cam30.exr", NULL);
    g_assert_cmpint(truncate(frame, 1000), ==, 0);
    does(run, 1, "process", run->session, NULL);
    assert_has(run->err, frame);
    assert_has(run->err, "mesorig resume");
    does(run, 0, "resume", run->session, NULL);
    g_assert_cmpint(g_remove(frame), ==, 0);
    does(run, 1, "process", run->session, NULL);
    assert_has(run->err, frame);
    assert_has(run->err, "mesorig resume");
    does(run, 0, "resume", run->session, NULL);
    check_products(run);
    run_free(run);
}

/* A disk of our own; NULL where that is not allowed. */
static char *mount_disk(const char *size) {
    char *path = g_strdup_printf("%s/disk%d", top, n_made++);
    g_autofree char *options = g_strconcat("size=", size, NULL);
    g_assert_cmpint(g_mkdir(path, 0777), ==, 0);
    if (mount("mesorig-test", path, "tmpfs", 0, options) == 0)
        return path;
    g_test_skip("a disk cannot be mounted here");
    g_free(path);
    return NULL;
}

static void unmount_disk(char *path) {
    g_assert_cmpint(umount2(path, MNT_DETACH), ==, 0);
    g_free(path);
}

static void test_disk_too_small(void) {
    char *disk = mount_disk("1m");
    if (!disk)
        return;
    struct run *run = run_new_in(disk, NULL);
    capture(run, 1);
    assert_has(run->err, run->session);
    assert_has(run->err, "the session needs ");
    assert_has(run->err, "are free there; free some space or choose another disk");
    g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
    run_free(run);
    unmount_disk(disk);
}

/* Takes all that is free, a moment after the first frame is there. */
static gpointer fill_disk(gpointer data) {
    struct run *run = data;
    g_autofree char *ballast = g_build_filename(run->directory, "ballast", NULL);
    g_autofree char *frames = g_build_filename(run->session, "frames", NULL);
    const gint64 until = g_get_monotonic_time() + 60 * G_USEC_PER_SEC;
    int fd = open(ballast, O_CREAT | O_WRONLY | O_CLOEXEC, 0666);
    struct statvfs stat;
    gboolean any = FALSE;
    while (!any && g_get_monotonic_time() < until) {
        g_autoptr(GDir) dir = g_dir_open(frames, 0, NULL);
        any = dir && g_dir_read_name(dir);
        g_usleep(200);
    }
    gint64 taken = 0;
    while (statvfs(run->directory, &stat) == 0 && stat.f_bavail > 0) {
        const gint64 more = (gint64)(stat.f_bavail * stat.f_frsize);
        if (posix_fallocate(fd, taken, more) == 0)
            taken += more;
    }
    close(fd);
    return NULL;
}

/* A longer session, with a sample that is seen whole from everywhere. */
static char *write_small_sample(const struct run *run) {
    static const struct change changes[] = {{"[sample]", "width_mm = 40"},
                                            {"[sample]", "height_mm = 40"}};
    char *path = write_long_session(run->directory);
    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++) {
        g_autofree char *text = read_file(path);
        g_autofree char *changed = changed_text(text, &changes[i]);
        write_file(path, changed, -1);
    }
    return path;
}

/* The disk is full in the middle: nothing is lost, and when there is room again it goes on. */
static void test_disk_full(void) {
    char *disk = mount_disk("90m");
    if (!disk)
        return;
    struct run *whole = run_new(NULL), *run = run_new_in(disk, NULL);
    g_autofree char *conf = write_small_sample(run);
    g_autofree char *ballast = g_build_filename(run->directory, "ballast", NULL);
    does(whole, 0, "capture", whole->rig, conf, "-o", whole->session, NULL);
    does(whole, 0, "process", whole->session, NULL);
    g_autofree char *expected = products_of(whole->session);
    g_autoptr(GThread) filler = g_thread_new("filler", fill_disk, run);
    does(run, 1, "capture", run->rig, conf, "-o", run->session, NULL);
    g_thread_join(g_steal_pointer(&filler));
    g_test_message("%s", run->err);
    assert_has(run->out, "error: disk: The disk is full: ");
    assert_has(run->err, "mesorig: paused, the rig is safe: The disk is full: ");
    assert_has(run->err, "Nothing was lost; free some space, then go on.");
    assert_has(run->err, "to go on: mesorig resume ");
    does(run, 1, "resume", run->session, NULL); /* it is full still */
    assert_has(run->err, "free");
    g_assert_cmpint(g_remove(ballast), ==, 0);
    g_autofree char *before = frames_of(run->session);
    does(run, 0, "resume", run->session, NULL);
    g_autofree char *after = frames_of(run->session);
    g_assert_true(begins_with(after, before));
    does(run, 0, "process", run->session, NULL);
    g_autofree char *products = products_of(run->session);
    g_assert_cmpstr(products, ==, expected);
    run_free(run);
    run_free(whole);
    unmount_disk(disk);
}

static void add_faults(const char *prefix, const struct fault *list, gsize n,
                       GTestDataFunc function) {
    for (gsize i = 0; i < n; i++) {
        g_autofree char *name = g_strconcat(prefix, list[i].name, NULL);
        g_test_add_data_func(name, &list[i], function);
    }
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    top = g_dir_make_tmp("mesorig-faults-XXXXXX", NULL);
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    /* Whatever else runs on this machine is none of ours. */
    g_setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("DBUS_SESSION_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("XDG_RUNTIME_DIR", top, TRUE);
    add_faults("/faults/", faults, G_N_ELEMENTS(faults), test_fault);
    add_faults("/faults/", passing, G_N_ELEMENTS(passing), test_passing);
    g_test_add_func("/faults/daemon-stays", test_daemon_stays);
    g_test_add_func("/input/mistakes", test_mistakes);
    g_test_add_func("/input/other-rig", test_other_rig);
    g_test_add_func("/input/garbage-database", test_garbage_database);
    g_test_add_func("/input/damaged-frames", test_damaged_frames);
    g_test_add_func("/disk/too-small", test_disk_too_small);
    g_test_add_func("/disk/full", test_disk_full);
    const int result = g_test_run();
    remove_tree(top);
    g_free(top);
    return result;
}
