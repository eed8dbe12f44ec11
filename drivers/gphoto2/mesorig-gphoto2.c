/* mesorig-gphoto2: a camera of libgphoto2 as a program for the driver gphoto2-camera.
 * docs/build-a-rig/programs.md describes the requests. The program has one thread. While it waits
 * for a picture, it looks for a "stop". If it hangs inside the library, its parent kills it. */
#include "convert.h"
#include "still.h"

#include "base/program.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define ANSWER_US 300000 /* time before a deadline in which an error is still answered */
#define FIRST_US  10000  /* exposure of the first picture, approximately */
#define MAX_LINE  65536
#define FAILED    1

static char *port, *model, *iso, *aperture, *shutter, **settings;
static gboolean keep_on_card, list;
static int trigger_ms = 500, readout_ms = 3000;

static const GOptionEntry entries[] = {
    {"list", 0, 0, G_OPTION_ARG_NONE, &list, "List the cameras on USB", NULL},
    {"port", 0, 0, G_OPTION_ARG_STRING, &port, "Where the camera is; default: usb", "PORT"},
    {"model", 0, 0, G_OPTION_ARG_STRING, &model, "Name of the camera in libgphoto2", "MODEL"},
    {"iso", 0, 0, G_OPTION_ARG_STRING, &iso, "ISO speed", "ISO"},
    {"aperture", 0, 0, G_OPTION_ARG_STRING, &aperture, "F-number", "F"},
    {"shutter", 0, 0, G_OPTION_ARG_STRING, &shutter, "The setting that is the exposure time",
     "NAME"},
    {"set", 0, 0, G_OPTION_ARG_STRING_ARRAY, &settings, "A further setting", "NAME=VALUE"},
    {"keep-on-card", 0, 0, G_OPTION_ARG_NONE, &keep_on_card, "Leave the pictures on the card",
     NULL},
    {"trigger-ms", 0, 0, G_OPTION_ARG_INT, &trigger_ms,
     "Longest time from the trigger to the exposure", "MS"},
    {"readout-ms", 0, 0, G_OPTION_ARG_INT, &readout_ms,
     "Time from the end of the exposure to the picture", "MS"},
    {NULL},
};

struct helper {
    int in; /* standard input */
    struct still_options options;
    Still *still;
    char *folder;
    int silence_ms; /* the program ends if no request comes for this time; −1: without limit */
    gint64 n_pictures;
    GByteArray *input;
    gboolean ended;   /* the program shall end, for example because its input has ended */
    gboolean stopped; /* a "stop" came while a picture was taken */
};

static void print_node(JsonObject *message) {
    g_autoptr(JsonNode) root = json_node_new(JSON_NODE_OBJECT);
    json_object_set_string_member(message, "jsonrpc", "2.0");
    json_node_take_object(root, message);
    g_autofree char *text = json_to_string(root, FALSE);
    g_print("%s\n", text);
    fflush(stdout);
}

/* Takes ownership of result. */
static void answer(gint64 id, JsonObject *result, const GError *error) {
    JsonObject *message = json_object_new();
    json_object_set_int_member(message, "id", id);
    if (error) {
        JsonObject *failure = json_object_new();
        json_object_set_int_member(failure, "code", FAILED);
        json_object_set_string_member(failure, "message", error->message);
        json_object_set_object_member(message, "error", failure);
        g_clear_pointer(&result, json_object_unref);
    } else {
        json_object_set_object_member(message, "result", result ? result : json_object_new());
    }
    print_node(message);
}

/* Waits up to wait_ms for input (−1: without limit) and reads it. Returns FALSE if none came. */
static gboolean read_input(struct helper *helper, int wait_ms) {
    guint8 bytes[4096];
    struct pollfd ready = {helper->in, POLLIN, 0};
    const int n_ready = poll(&ready, 1, wait_ms);
    if (n_ready <= 0)
        return n_ready < 0 && errno == EINTR;
    const gssize n = read(helper->in, bytes, sizeof bytes);
    if (n > 0)
        g_byte_array_append(helper->input, bytes, (guint)n);
    helper->ended = n <= 0 || helper->input->len > MAX_LINE;
    return TRUE;
}

/* Takes the next line that was read. Returns NULL if there is none. Free it with g_free(). */
static char *take_line(struct helper *helper) {
    GByteArray *input = helper->input;
    const guint8 *end = input->len > 0 ? memchr(input->data, '\n', input->len) : NULL;
    if (!end)
        return NULL;
    const guint length = (guint)(end - input->data);
    char *line = g_strndup((const char *)input->data, length);
    g_byte_array_remove_range(input, 0, length + 1);
    return line;
}

struct request {
    gint64 id;
    const char *method;
    JsonObject *params;
};

/* Reads a request. The parser owns its strings and objects. Returns FALSE if the line is not a
 * request with a method and params. */
static gboolean parse(JsonParser *parser, const char *line, struct request *ret) {
    if (!json_parser_load_from_data(parser, line, -1, NULL) ||
        !JSON_NODE_HOLDS_OBJECT(json_parser_get_root(parser)))
        return FALSE;
    JsonObject *object = json_node_get_object(json_parser_get_root(parser));
    JsonNode *params = json_object_get_member(object, "params");
    ret->id = json_object_get_int_member_with_default(object, "id", 0);
    ret->method = json_object_get_string_member_with_default(object, "method", NULL);
    ret->params = params && JSON_NODE_HOLDS_OBJECT(params) ? json_node_get_object(params) : NULL;
    return ret->method && ret->params;
}

/* Waits up to ms for requests, and answers them immediately. Returns FALSE if one was a "stop" or
 * if standard input has ended. */
static gboolean pause_shot(int ms, gpointer data) {
    struct helper *helper = data;
    g_autofree char *line = NULL;
    if (!helper->ended)
        read_input(helper, ms);
    while (!helper->ended && (line = take_line(helper))) {
        g_autoptr(JsonParser) parser = json_parser_new();
        struct request request;
        if (parse(parser, line, &request)) {
            answer(request.id, NULL, NULL);
            helper->stopped |= g_str_equal(request.method, "stop");
        }
        g_clear_pointer(&line, g_free);
    }
    return !helper->stopped && !helper->ended;
}

static void on_exposed(gpointer data) {
    JsonObject *message = json_object_new();
    json_object_set_string_member(message, "method", "exposed");
    json_object_set_object_member(message, "params", json_object_new());
    print_node(message);
}

static void ignore_exposed(gpointer data) {
}

/* Takes a picture. Returns the name of its PGM in the folder, or NULL with an error. */
static char *take_picture(struct helper *helper, gint64 exposure_us, gint64 deadline_us,
                          void (*exposed)(gpointer data), struct converted *ret, GError **error) {
    const struct still_shot shot = {.exposure_us = exposure_us,
                                    .deadline_us = deadline_us,
                                    .folder = helper->folder,
                                    .wait = {pause_shot, exposed, helper}};
    helper->stopped = FALSE;
    g_autofree char *file = still_shoot(helper->still, &shot, error);
    if (!file)
        return NULL;
    g_autofree char *name = g_strdup_printf("%" G_GINT64_FORMAT ".pgm", ++helper->n_pictures);
    g_autofree char *pgm = g_build_filename(helper->folder, name, NULL);
    const gboolean converted = convert_to_pgm(file, pgm, ret, error);
    g_unlink(file);
    return converted ? g_steal_pointer(&name) : NULL;
}

static JsonObject *hello(struct helper *helper, JsonObject *params, GError **error) {
    JsonObject *result = json_object_new();
    JsonArray *capabilities = json_array_new();
    const char *folder = json_object_get_string_member_with_default(params, "folder", NULL);
    helper->silence_ms = (int)json_object_get_int_member_with_default(params, "silence_ms", -1);
    g_free(helper->folder);
    helper->folder = g_strdup(folder ? folder : g_get_tmp_dir());
    json_array_add_string_element(capabilities, "silence");
    json_array_add_string_element(capabilities, "stop");
    json_object_set_int_member(result, "version", 1);
    json_object_set_string_member(result, "class", "camera");
    json_object_set_array_member(result, "capabilities", capabilities);
    helper->still = still_open(&helper->options, error);
    if (helper->still) {
        json_object_set_string_member(result, "device", still_model(helper->still));
        json_object_set_string_member(result, "serial", still_serial(helper->still));
    }
    return result;
}

/* Takes the first picture, because only a picture shows the size and the colour filter. */
static JsonObject *open_camera(struct helper *helper, gint64 deadline_us, GError **error) {
    const GArray *times = still_exposures(helper->still);
    JsonObject *result = json_object_new();
    JsonArray *exposures = json_array_new();
    struct converted picture = {0};
    gint64 first_us = g_array_index(times, gint64, 0);
    for (guint i = 0; i < times->len; i++) {
        const gint64 us = g_array_index(times, gint64, i);
        json_array_add_int_element(exposures, us);
        if (ABS(us - FIRST_US) < ABS(first_us - FIRST_US))
            first_us = us;
    }
    json_object_set_array_member(result, "exposures_us", exposures);
    g_autofree char *name =
        take_picture(helper, first_us, deadline_us, ignore_exposed, &picture, error);
    if (!name)
        return result;
    g_autofree char *path = g_build_filename(helper->folder, name, NULL);
    g_unlink(path);
    if (!picture.raw)
        g_printerr(
            "mesorig-gphoto2: %s: the pictures are JPEG; their values are not proportional to "
            "the light; set the camera to raw files\n",
            still_model(helper->still));
    json_object_set_int_member(result, "width", picture.width);
    json_object_set_int_member(result, "height", picture.height);
    json_object_set_string_member(result, "cfa", picture.cfa);
    json_object_set_int_member(result, "bits", CONVERT_BITS);
    json_object_set_int_member(result, "black_level", CONVERT_BLACK);
    json_object_set_int_member(result, "min_exposure_us", g_array_index(times, gint64, 0));
    json_object_set_int_member(result, "max_exposure_us",
                               g_array_index(times, gint64, times->len - 1));
    json_object_set_int_member(result, "trigger_ms", helper->options.trigger_ms);
    json_object_set_int_member(result, "readout_ms", helper->options.readout_ms);
    return result;
}

static JsonObject *trigger(struct helper *helper, JsonObject *params, gint64 deadline_us,
                           GError **error) {
    JsonObject *result = json_object_new();
    struct converted picture;
    const gint64 exposure_us = json_object_get_int_member_with_default(params, "exposure_us", 0);
    g_autofree char *name =
        take_picture(helper, exposure_us, deadline_us, on_exposed, &picture, error);
    if (name) {
        json_object_set_string_member(result, "file", name);
        json_object_set_int_member(result, "id", helper->n_pictures);
    }
    return result;
}

static void obey(struct helper *helper, const struct request *request) {
    g_autoptr(GError) error = NULL;
    JsonObject *result = NULL;
    const gint64 ms = json_object_get_int_member_with_default(request->params, "deadline_ms", 1000);
    const gint64 deadline_us = g_get_monotonic_time() + ms * 1000 - ANSWER_US;
    const gboolean is_hello = g_str_equal(request->method, "hello");
    const gboolean is_open = g_str_equal(request->method, "open");
    const gboolean is_trigger = g_str_equal(request->method, "trigger");
    if (is_hello && !helper->still)
        result = hello(helper, request->params, &error);
    else if ((is_open || is_trigger) && !helper->still)
        g_set_error(&error, G_IO_ERROR, G_IO_ERROR_FAILED,
                    "the request “%s” came before “hello”; send “hello” first", request->method);
    else if (is_open)
        result = open_camera(helper, deadline_us, &error);
    else if (is_trigger)
        result = trigger(helper, request->params, deadline_us, &error);
    else if (helper->still && g_str_equal(request->method, "ping"))
        still_idle(helper->still);
    else if (g_str_equal(request->method, "close"))
        helper->ended = TRUE;
    answer(request->id, result, error);
}

static void run(void) {
    struct helper helper = {
        /* Not descriptor 0, which libgphoto2 closes (hold_descriptor() in still.c). */
        .in = fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1),
        .options = {.port = port ? port : "usb",
                    .model = model,
                    .iso = iso,
                    .aperture = aperture,
                    .shutter = shutter,
                    .settings = (const char *const *)settings,
                    .keep_on_card = keep_on_card,
                    .trigger_ms = trigger_ms,
                    .readout_ms = readout_ms},
        .silence_ms = -1,
        .input = g_byte_array_new()};
    while (!helper.ended) {
        g_autofree char *line = take_line(&helper);
        g_autoptr(JsonParser) parser = json_parser_new();
        struct request request;
        if (!line) {
            helper.ended |= !read_input(&helper, helper.silence_ms);
            continue;
        }
        if (parse(parser, line, &request))
            obey(&helper, &request);
        else
            g_printerr(
                "mesorig-gphoto2: this line is not a request with “method” and “params”: %s\n",
                line);
    }
    still_close(helper.still);
    g_free(helper.folder);
    g_byte_array_unref(helper.input);
}

static const struct command_line command_line = {
    .name = "mesorig-gphoto2",
    .summary =
        "A DSLR or mirrorless camera as a device of mesorigd, which starts this program for a "
        "section with driver = gphoto2-camera. Requests come on standard input, as JSON.",
    .options = entries,
};

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    program_parse(&command_line, &argc, &argv);
    signal(SIGPIPE, SIG_IGN); /* libgphoto2 writes to connections that have ended */
    if (list && !still_list(&error))
        g_printerr("mesorig-gphoto2: %s\n", error->message);
    else if (!list)
        run();
    fflush(stdout);
    /* Not exit(), because libgphoto2 does not free the tables of its camera drivers, which
     * LeakSanitizer would report. */
    _exit(error != NULL);
}
