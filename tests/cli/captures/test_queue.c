/* The queue of sessions as an operator uses it: with mesorig, and a daemon with a simulated rig. */
#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>

#include "bus/bus.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "session/session.h"

struct site {
    struct operation *run;
    GSubprocess *daemon;
    char *address, *queue, *log;
};

static void daemon_start(struct site *site) {
    site->daemon = process_start_ready(G_SUBPROCESS_FLAGS_NONE, site->log,
                                       (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen",
                                                        site->address, "--rig", site->run->rig,
                                                        "--queue", site->queue, NULL});
}

/* With a signal: SIGTERM or SIGKILL. */
static void daemon_end(struct site *site, int signal) {
    g_subprocess_send_signal(site->daemon, signal);
    g_subprocess_wait(site->daemon, NULL, NULL);
    if (signal == SIGTERM && !g_subprocess_get_successful(site->daemon)) {
        g_autofree char *log = NULL;
        g_file_get_contents(site->log, &log, NULL, NULL);
        g_error("mesorigd has failed: %s", log);
    }
    g_clear_object(&site->daemon);
}

static struct site *site_new(const struct change *changes) {
    struct site *site = g_new0(struct site, 1);
    site->run = operator_new(changes);
    site->address = g_strdup_printf("unix:path=%s/bus", site->run->directory);
    site->queue = g_build_filename(site->run->directory, "queue", NULL);
    site->log = g_build_filename(site->run->directory, "log", NULL);
    daemon_start(site);
    return site;
}

static void site_free(struct site *site) {
    if (site->daemon)
        daemon_end(site, SIGTERM);
    operator_free(site->run);
    g_free(site->address);
    g_free(site->queue);
    g_free(site->log);
    g_free(site);
}

#define QUEUE(site, code, word, ...)                                                               \
    operator_does((site)->run, code, "queue", word, "--address", (site)->address, __VA_ARGS__, NULL)

/* Writes FOLDER/NAME.conf, the small session with another name and lines instead of those of the
 * same keys; g_free(). */
static char *write_session(const struct site *site, const char *name,
                           const struct change *changes) {
    g_autofree char *line = g_strconcat("name = ", name, NULL), *text = NULL;
    g_autofree char *file = g_strconcat(name, ".conf", NULL);
    g_assert_true(g_file_get_contents(site->run->conf, &text, NULL, NULL));
    char *changed = small_rig_changed(text, &(struct change){"[session]", line});
    for (; changes && changes->head; changes++) {
        char *more = small_rig_changed(changed, changes);
        g_free(changed);
        changed = more;
    }
    char *path = g_build_filename(site->run->directory, file, NULL);
    g_assert_true(g_file_set_contents(path, changed, -1, NULL));
    g_free(changed);
    return path;
}

static char *directory_of(const struct site *site, const char *name) {
    return g_strdup_printf("%s/%s.session", site->run->directory, name);
}

static void add(struct site *site, const char *conf) {
    QUEUE(site, 0, "add", conf, "--into", site->run->directory);
}

/* What the list says in JSON; the caller's. */
static JsonParser *read_list(struct site *site) {
    JsonParser *parser = json_parser_new();
    operator_does(site->run, 0, "queue", "list", "--address", site->address, "--json", NULL);
    g_assert_true(json_parser_load_from_data(parser, site->run->out, -1, NULL));
    return parser;
}

static JsonObject *object_of(JsonParser *parser) {
    return json_node_get_object(json_parser_get_root(parser));
}

/* The states in order, "done stopped waiting"; and the queue's own behind them. g_free(). */
static char *states(struct site *site) {
    g_autoptr(JsonParser) parser = read_list(site);
    JsonArray *list = json_object_get_array_member(object_of(parser), "queue");
    GString *to = g_string_new(NULL);
    for (guint i = 0; i < json_array_get_length(list); i++)
        g_string_append_printf(
            to, "%s ",
            json_object_get_string_member(json_array_get_object_element(list, i), "state"));
    g_string_append(to, json_object_get_string_member(object_of(parser), "queue_state"));
    return g_string_free(to, FALSE);
}

/* The same from the daemon's properties, without a start of mesorig. */
static gboolean daemon_has(const struct site *site, const char *wanted) {
    g_autoptr(GVariant) properties = operator_properties(site->address), list = NULL;
    g_autoptr(GString) found = g_string_new(NULL);
    const char *state = NULL;
    g_assert_true(g_variant_lookup(properties, "QueueState", "&s", &state));
    g_assert_true(g_variant_lookup(properties, "Queue", "@aa{sv}", &list));
    for (gsize i = 0; i < g_variant_n_children(list); i++) {
        g_autoptr(GVariant) item = g_variant_get_child_value(list, i);
        const char *of_item = NULL;
        g_assert_true(g_variant_lookup(item, "state", "&s", &of_item));
        g_string_append_printf(found, "%s ", of_item);
    }
    g_string_append(found, state);
    return g_str_equal(found->str, wanted);
}

/* Until mesorig says so. */
static void wait_for(struct site *site, const char *wanted) {
    g_autofree char *found = NULL;
    const gint64 until = g_get_monotonic_time() + WAIT_S * G_USEC_PER_SEC;
    while (strcmp(found = states(site), wanted) != 0) {
        if (g_get_monotonic_time() > until)
            g_error("the queue is “%s”, not “%s”: %s", found, wanted, site->run->out);
        g_free(found);
        do
            g_usleep(G_USEC_PER_SEC / 20);
        while (!daemon_has(site, wanted) && g_get_monotonic_time() <= until);
    }
}

/* Shots that are done, and all. */
static void count_shots(const char *path, int *ret_done, int *ret_all) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autoptr(GPtrArray) shots = session ? session_shots(session, NULL) : NULL;
    *ret_done = 0;
    *ret_all = shots ? (int)shots->len : 0;
    for (int i = 0; i < *ret_all; i++)
        *ret_done += ((const struct session_shot *)shots->pdata[i])->state == SHOT_DONE;
}

/* Waits until so many shots of a session are done. */
static void wait_for_shots(const struct site *site, const char *name, int n) {
    g_autofree char *path = directory_of(site, name);
    int done = 0, all;
    UNTIL (done >= n) {
        g_usleep(G_USEC_PER_SEC / 100);
        count_shots(path, &done, &all);
    }
}

static void call_daemon(const struct site *site, const char *method) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GDBusConnection) connection = g_dbus_connection_new_for_address_sync(
        site->address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, &error);
    g_assert_no_error(error);
    g_autoptr(GVariant) answer =
        g_dbus_connection_call_sync(connection, NULL, BUS_PATH, BUS_NAME, method, NULL, NULL,
                                    G_DBUS_CALL_FLAGS_NONE, WAIT_S * 1000, NULL, &error);
    g_assert_no_error(error);
}

/* Calls a method of the daemon as soon as there is a shot of a session: a program might start too
 * late to come before its last one. */
static void call_amid(const struct site *site, const char *name, const char *method) {
    wait_for_shots(site, name, 1);
    call_daemon(site, method);
}

static void assert_whole(const struct site *site, const char *name) {
    g_autofree char *path = directory_of(site, name);
    int done, all;
    count_shots(path, &done, &all);
    g_assert_cmpint(all, >, 10);
    g_assert_cmpint(done, ==, all);
}

static const struct change dark[] = {{"[capture]", "exposures_us = 10; 20"}, {NULL, NULL}};
/* Some seconds of pictures; from 500 on there would be test shots. */
static const struct change many[] = {
    {"[views]", "rings = 30:12; 60:12"}, {"[lights]", "rings = 30:10; 60:10"}, {NULL, NULL}};
static const struct change parked[] = {
    {"[axis arc]", "park_deg = 123"}, {"[axis turntable]", "park_deg = -30"}, {NULL, NULL}};

/* The second session faults: the third is captured all the same, and then the rig rests. */
TEST(three) {
    struct site *site = site_new(parked);
    g_autofree char *first = write_session(site, "first", NULL);
    g_autofree char *second = write_session(site, "second", dark);
    g_autofree char *third = write_session(site, "third", NULL);
    QUEUE(site, 0, "add", first, second, third, "--into", site->run->directory, "--process");
    wait_for(site, "done stopped done empty");
    QUEUE(site, 0, "list", "--json");
    assert_has(site->run->out, "lamp lamp30 gives no light");
    assert_has(site->run->out, "To continue it: mesorig resume ");
    UNTIL (strstr(site->run->out, "parked")) {
        g_usleep(G_USEC_PER_SEC / 10);
        QUEUE(site, 0, "list", "--json");
    }
    assert_has(site->run->out, "lamps and lasers are off, the axes are parked");
    assert_whole(site, "first");
    assert_whole(site, "third");
    operator_does(site->run, 0, "status", "--address", site->address, NULL);
    assert_has(site->run->out, "queue      empty: lamps and lasers are off, the axes are parked");
    g_autofree char *bus_log = NULL;
    g_assert_true(g_file_get_contents(site->log, &bus_log, NULL, NULL));
    g_assert_null(strstr(bus_log, "CRITICAL"));
    QUEUE(site, 0, "remove", "--ended");
    wait_for(site, "empty");
    site_free(site);
}

/* Waits until “mesorig status” names a session that is processed, or none. */
static void wait_for_processing(struct site *site, gboolean wanted) {
    gboolean found = !wanted;
    UNTIL (found == wanted) {
        operator_does(site->run, 0, "status", "--address", site->address, NULL);
        found = strstr(site->run->out, "\nprocessing /") != NULL;
        g_usleep(G_USEC_PER_SEC / 20);
    }
}

static void assert_product(const char *session) {
    g_autofree char *product = g_build_filename(session, "products", "eigenmaps.exr", NULL);
    g_assert_true(g_file_test(product, G_FILE_TEST_EXISTS));
}

/* “mesorig capture --process” of a daemon ends when the products exist. Sessions of the queue are
 * processed while the next one is captured. */
TEST(processed) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", NULL);
    g_autofree char *second = write_session(site, "second", NULL);
    g_autofree char *of_first = directory_of(site, "first");
    g_autofree char *of_second = directory_of(site, "second");
    operator_does(site->run, 0, "capture", site->run->rig, site->run->conf, "-o",
                  site->run->session, "--process", "--address", site->address, NULL);
    assert_has(site->run->out, "Ctrl-C ends only this program");
    assert_product(site->run->session);
    QUEUE(site, 0, "add", first, second, "--into", site->run->directory, "--process");
    wait_for_processing(site, TRUE);
    wait_for(site, "done done empty");
    wait_for_processing(site, FALSE);
    assert_product(of_first);
    assert_product(of_second);
    site_free(site);
}

/* Killed in the middle of a session: it is gone on with, and nothing is taken twice. */
TEST(killed) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", many);
    g_autofree char *second = write_session(site, "second", NULL);
    g_autofree char *path = directory_of(site, "first");
    int done = 0, all = 0;
    QUEUE(site, 0, "add", first, second, "--into", site->run->directory);
    wait_for_shots(site, "first", 3);
    daemon_end(site, SIGKILL);
    count_shots(path, &done, &all);
    g_assert_cmpint(done, >=, 3);
    g_assert_cmpint(done, <, all);
    g_autofree char *before = operator_frames(path);
    daemon_start(site);
    wait_for(site, "done done empty");
    assert_whole(site, "first");
    assert_whole(site, "second");
    g_autofree char *after = operator_frames(path);
    g_auto(GStrv) lines = g_strsplit(before, "\n", -1);
    for (char **line = lines; *line && **line; line++)
        if (!strstr(after, *line))
            g_error("a frame that was there has changed: %s", *line);
    g_autofree char *log = NULL;
    g_assert_true(g_file_get_contents(site->log, &log, NULL, NULL));
    assert_has(log, "resumed: ");
    site_free(site);
}

/* A daemon that was ended normally also continues its queue, and the numbers of sessions continue.
 */
TEST(restarted) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", many);
    QUEUE(site, 0, "pause", NULL);
    add(site, first);
    wait_for(site, "waiting paused");
    daemon_end(site, SIGTERM);
    daemon_start(site);
    wait_for(site, "waiting paused");
    assert_has(site->run->out, "paused by hand");
    QUEUE(site, 0, "resume", NULL);
    wait_for_shots(site, "first", 1);
    daemon_end(site, SIGTERM);
    daemon_start(site);
    wait_for(site, "done empty");
    assert_whole(site, "first");
    QUEUE(site, 0, "pause", NULL);
    g_autofree char *second = write_session(site, "second", NULL);
    add(site, second);
    assert_has(site->run->out, "added as number 2: ");
    assert_has(site->run->out, "the queue is paused: paused by hand");
    site_free(site);
}

/* What mesorig-web says about the queue. */
static void check_web(const struct site *site) {
    g_autoptr(GError) error = NULL;
    GSubprocess *server = process_start(G_SUBPROCESS_FLAGS_STDOUT_PIPE, NULL,
                                        (const char *[]){BUILD_DIR "/bin/mesorig-web", "--address",
                                                         site->address, "--port", "0", NULL});
    g_autoptr(GDataInputStream) out = g_data_input_stream_new(g_subprocess_get_stdout_pipe(server));
    g_autofree char *uri = ok(g_data_input_stream_read_line(out, NULL, NULL, ERR));
    uri[strcspn(uri, " ")] = '\0';
    g_autofree char *state = g_strconcat(uri, "api/v1/state", NULL);
    g_autoptr(SoupSession) http = soup_session_new_with_options("timeout", WAIT_S, NULL);
    g_autoptr(SoupMessage) message = soup_message_new("GET", state);
    g_autoptr(GBytes) answer = soup_session_send_and_read(http, message, NULL, &error);
    g_assert_no_error(error);
    g_autofree char *text = g_strndup(g_bytes_get_data(answer, NULL), g_bytes_get_size(answer));
    assert_has(text, "\"queue_state\": \"hands\"");
    assert_has(text, "\"prompt\": \"lay the felt on the turntable\"");
    assert_has(text, "\"name\": \"c\"");
    g_subprocess_send_signal(server, SIGTERM);
    g_subprocess_wait(server, NULL, NULL);
    g_object_unref(server);
}

TEST(changed) {
    static const struct change hands[] = {{"[session]", "prompt = lay the felt on the turntable"},
                                          {NULL, NULL}};
    struct site *site = site_new(NULL);
    static const char *const names[] = {"a", "b", "c"};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *conf = write_session(site, names[i], i == 0 ? hands : NULL);
        add(site, conf);
    }
    wait_for(site, "hands waiting waiting hands");
    assert_has(site->run->out, "\"prompt\": \"lay the felt on the turntable\"");
    operator_does(site->run, 0, "status", "--address", site->address, NULL);
    assert_has(site->run->out, "to do      lay the felt on the turntable");
    check_web(site);
    /* Moved back, the session for which nothing has to be done comes first. */
    QUEUE(site, 0, "move", "1", "3");
    wait_for(site, "done done hands hands");
    QUEUE(site, 1, "move", "2", "1");
    assert_has(site->run->err, "session 2 cannot be moved, because it has ended: add it again");
    QUEUE(site, 1, "remove", "7");
    assert_has(site->run->err, "the queue has no session 7");
    QUEUE(site, 2, "remove", NULL);
    QUEUE(site, 1, "remove", "x");
    operator_does(site->run, 0, "continue", "--address", site->address, NULL);
    wait_for(site, "done done done empty");
    assert_whole(site, "a");
    operator_does(site->run, 1, "continue", "--address", site->address, NULL);
    assert_has(site->run->err, "nothing is being captured");
    site_free(site);
}

/* Mistakes in all files are reported immediately, and nothing is added. */
TEST(mistakes) {
    static const struct change wrong[] = {
        {"[capture]", "sweep_steps = 3"}, {"[sample]", "texels = many"}, {NULL, NULL}};
    struct site *site = site_new(NULL);
    g_autofree char *good = write_session(site, "good", NULL);
    g_autofree char *bad = write_session(site, "bad", wrong);
    g_autofree char *worse = write_session(site, "worse", wrong);
    QUEUE(site, 1, "add", good, bad, worse, "--into", site->run->directory);
    assert_has(site->run->err, "nothing was added");
    assert_has(site->run->err, "bad.conf: 2 mistakes");
    assert_has(site->run->err, "worse.conf: 2 mistakes");
    QUEUE(site, 1, "add", bad, "--into", site->run->directory);
    assert_has(site->run->err, "sweep_steps");
    assert_has(site->run->err, "texels");
    wait_for(site, "empty");
    QUEUE(site, 2, "add", good, bad, "-o", "/x");
    QUEUE(site, 2, "ad", NULL);
    assert_has(site->run->err, "did you mean “add”?");
    /* A directory that exists, or that another session of the queue will make. */
    QUEUE(site, 1, "add", good, "-o", site->run->directory);
    QUEUE(site, 0, "pause", NULL);
    add(site, good);
    QUEUE(site, 1, "add", good, "--into", site->run->directory);
    assert_has(site->run->err, "session 1 of the queue has the directory ");
    /* The file may change afterwards: what was checked is captured. */
    g_assert_cmpint(g_unlink(good), ==, 0);
    QUEUE(site, 0, "resume", NULL);
    wait_for(site, "done empty");
    assert_whole(site, "good");
    site_free(site);
}

/* A fault of the rig pauses the queue, and the session is not changed until somebody continues it.
 */
TEST(rig_faults) {
    static const struct change stalls[] = {{"[axis arc]", "fault_stall_at = 2"}, {NULL, NULL}};
    struct site *site = site_new(stalls);
    g_autofree char *first = write_session(site, "first", NULL);
    g_autofree char *second = write_session(site, "second", NULL);
    QUEUE(site, 0, "add", first, second, "--into", site->run->directory);
    wait_for(site, "begun waiting paused");
    assert_has(site->run->out, "session 1 is paused by a fault: axis arc");
    QUEUE(site, 1, "remove", "1");
    assert_has(site->run->err, "session 1 cannot be removed, because it is being captured");
    QUEUE(site, 0, "resume", NULL);
    wait_for(site, "done done empty");
    assert_whole(site, "first");
    assert_whole(site, "second");
    site_free(site);
}

/* So does a laser that does not go off. */
TEST(laser_stays_on) {
    static const struct change stays_on[] = {{"[laser laser30]", "fault_stays_on = yes"},
                                             {NULL, NULL}};
    struct site *site = site_new(stays_on);
    g_autofree char *first = write_session(site, "first", NULL);
    g_autofree char *second = write_session(site, "second", NULL);
    QUEUE(site, 0, "add", first, second, "--into", site->run->directory);
    wait_for(site, "begun waiting paused");
    assert_has(site->run->out, "session 1 is paused by a fault: laser laser30 stays on");
    site_free(site);
}

/* A person who ends a session or makes the rig safe stands at the rig, so no further session
 * begins. */
TEST(ended_by_hand) {
    static const char *const ends[] = {"Abort", "SafeState"};
    for (gsize i = 0; i < G_N_ELEMENTS(ends); i++) {
        struct site *site = site_new(NULL);
        g_autofree char *first = write_session(site, "first", many);
        g_autofree char *second = write_session(site, "second", NULL);
        QUEUE(site, 0, "add", first, second, "--into", site->run->directory);
        call_amid(site, "first", ends[i]);
        wait_for(site, "stopped waiting paused");
        assert_has(
            site->run->out,
            "the capture was aborted, and its frames are kept; to continue it: mesorig resume ");
        if (i == 1) {
            QUEUE(site, 1, "resume", NULL);
            assert_has(site->run->err, "mesorig release");
            call_daemon(site, "Release");
        }
        QUEUE(site, 0, "resume", NULL);
        wait_for(site, "stopped done empty");
        site_free(site);
    }
}

/* The rig file changes during a session: the next session waits until the file is opened again. */
TEST(rig_file_changed) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", many);
    g_autofree char *second = write_session(site, "second", NULL);
    g_autofree char *text = NULL;
    ok(g_file_get_contents(site->run->rig, &text, NULL, ERR));
    g_autofree char *changed =
        small_rig_changed(text, &(struct change){"[axis arc]", "park_deg = 5"});
    QUEUE(site, 0, "add", first, second, "--into", site->run->directory);
    wait_for_shots(site, "first", 1);
    ok(g_file_set_contents(site->run->rig, changed, -1, ERR));
    wait_for(site, "done waiting paused");
    assert_has(site->run->out, "has changed since mesorigd opened it");
    assert_has(site->run->out, "then mesorig queue resume");
    daemon_end(site, SIGTERM);
    daemon_start(site);
    QUEUE(site, 0, "resume", NULL);
    wait_for(site, "done done empty");
    assert_whole(site, "second");
    site_free(site);
}

/* Two sessions in a row that stop say something of the rig. */
TEST(two_stop) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", dark);
    g_autofree char *second = write_session(site, "second", dark);
    g_autofree char *third = write_session(site, "third", NULL);
    QUEUE(site, 0, "add", first, second, third, "--into", site->run->directory);
    wait_for(site, "stopped stopped waiting paused");
    assert_has(site->run->out, "2 sessions in a row have stopped");
    QUEUE(site, 0, "resume", NULL);
    wait_for(site, "stopped stopped done empty");
    site_free(site);
}

/* Test shots before a long session, and exposures that are auto. */
TEST(tried) {
    static const struct change bright[] = {{"[views]", "rings = 30:24; 60:24"},
                                           {"[lights]", "rings = 30:24; 60:24"},
                                           {"[capture]", "exposures_us = 4000000; 8000000"},
                                           {NULL, NULL}};
    static const struct change automatic[] = {{"[capture]", "exposures_us = auto"}, {NULL, NULL}};
    struct site *site = site_new(NULL);
    g_autofree char *spoilt = write_session(site, "spoilt", bright);
    g_autofree char *chosen = write_session(site, "chosen", automatic);
    g_autofree char *path = directory_of(site, "chosen");
    QUEUE(site, 0, "add", spoilt, chosen, "--into", site->run->directory);
    wait_for(site, "stopped done empty");
    assert_has(site->run->out, "so the capture was not begun");
    assert_has(site->run->out, "are saturated at 4e+06");
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autofree char *said = session ? session_value(session, "chosen") : NULL;
    assert_has(said, "exposures_us = ");
    site_free(site);
}

/* A file of the queue that cannot be used is kept and reported, and no session begins. */
TEST(damaged) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", NULL);
    g_autofree char *damaged = g_strconcat(site->queue, ".damaged", NULL);
    g_autofree char *text = NULL;
    QUEUE(site, 0, "pause", NULL);
    add(site, first);
    daemon_end(site, SIGTERM);
    g_assert_true(g_file_get_contents(site->queue, &text, NULL, NULL));
    g_assert_true(g_file_set_contents(site->queue, text, (gssize)strlen(text) * 2 / 3, NULL));
    g_assert_cmpint(g_chmod(site->queue, 0600), ==, 0);
    daemon_start(site);
    wait_for(site, "paused");
    assert_has(site->run->out, "the queue's file could not be used, and was renamed to ");
    g_assert_true(g_file_test(damaged, G_FILE_TEST_IS_REGULAR));
    add(site, first);
    QUEUE(site, 0, "resume", NULL);
    wait_for(site, "done empty");
    site_free(site);
}

/* A session that the daemon has not outlived three times is not begun again. */
TEST(crashes) {
    struct site *site = site_new(NULL);
    g_autofree char *first = write_session(site, "first", NULL), *text = NULL;
    QUEUE(site, 0, "pause", NULL);
    add(site, first);
    daemon_end(site, SIGTERM);
    g_assert_true(g_file_get_contents(site->queue, &text, NULL, NULL));
    g_auto(GStrv) parts = g_strsplit(text, "starts=0", 2);
    g_autofree char *crashed = g_strjoinv("starts=3", parts);
    g_assert_true(g_file_set_contents(site->queue, crashed, -1, NULL));
    g_assert_cmpint(g_chmod(site->queue, 0600), ==, 0);
    daemon_start(site);
    QUEUE(site, 0, "resume", NULL);
    wait_for(site, "stopped empty");
    assert_has(site->run->out, "mesorigd has ended unexpectedly 3 times");
    site_free(site);
}

/* Where an axis rests must be within its limits. */
TEST(park) {
    static const struct change beyond[] = {{"[axis sweep30]", "park_deg = 99"}, {NULL, NULL}};
    static const struct change word[] = {{"[axis arc]", "park_deg = there"}, {NULL, NULL}};
    const struct change *const changes[] = {beyond, word};
    static const char *const words[] = {
        "[axis sweep30] park_deg: 99 is outside the limits of the axis, -15 to 15 degrees",
        "[axis arc] park_deg: "};
    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++) {
        struct operation *run = operator_new(changes[i]);
        g_autofree char *address = g_strdup_printf("unix:path=%s/bus", run->directory);
        g_autofree char *said =
            process_text(1, (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen", address,
                                             "--rig", run->rig, NULL});
        assert_has(said, words[i]);
        operator_free(run);
    }
}

/* Without --queue, and twice on one file. */
TEST(kept_by_one) {
    struct site *site = site_new(NULL);
    g_autofree char *other = g_strdup_printf("unix:path=%s/other", site->run->directory);
    /* The second one has no queue, says why, and serves all the same. */
    GSubprocess *second =
        process_start_ready(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                            (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen", other,
                                             "--queue", site->queue, NULL});
    operator_does(site->run, 1, "queue", "list", "--address", other, NULL);
    assert_has(site->run->err, "this mesorigd keeps no queue: ");
    assert_has(site->run->err, "queue.lock: process ");
    operator_does(site->run, 0, "status", "--address", other, NULL);
    g_subprocess_send_signal(second, SIGTERM);
    g_subprocess_wait(second, NULL, NULL);
    g_object_unref(second);
    daemon_end(site, SIGTERM);
    GSubprocess *plain = process_start_ready(
        G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
        (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen", site->address, NULL});
    QUEUE(site, 1, "list", NULL);
    assert_has(site->run->err, "this mesorigd keeps no queue: start it with --queue FILE");
    operator_does(site->run, 0, "status", "--address", site->address, NULL);
    g_assert_null(strstr(site->run->out, "queue"));
    g_subprocess_send_signal(plain, SIGTERM);
    g_subprocess_wait(plain, NULL, NULL);
    g_object_unref(plain);
    site_free(site);
}

TESTS_RUN_BY(operator_tests);
