/* A camera that a program triggers. The answer to "trigger" names a file with the picture. */
#include "camera.h"

#include "devices.h"
#include "message.h"
#include "pgm.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

/* The program must answer a trigger within its delay + exposure + 3 read-outs +
 * PROGRAM_ANSWER_MS. That is 0.5 s before the deadline of the class, so that the error of the
 * program is reported. */
#define READOUTS 3

#define MAX_SIDE 65536
#define MAX_US   3.6e9
#define MAX_MS   60000.0

#define FIELD(name) G_STRUCT_OFFSET(struct program_camera, name)

static const struct option options[] = {
    PROGRAM_OPTIONS(FIELD(command)),
    {NULL},
};

/* Removes the pictures of earlier triggers. */
static void empty_folder(const struct program_camera *priv) {
    g_autoptr(GDir) dir = g_dir_open(priv->folder, 0, NULL);
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        g_autofree char *path = g_build_filename(priv->folder, name, NULL);
        g_remove(path);
    }
}

/* Makes the frame of an answer. If the answer has no time stamp, the exposure counts from the
 * sending of the trigger. The class refuses a picture that comes before this exposure can have
 * ended. */
static Frame *read_frame(Camera *camera, JsonObject *values, GError **error) {
    const struct program_camera *priv = camera->device.priv;
    const struct camera_format *format = &camera->format;
    gint64 id, start_us = priv->triggered_us;
    g_autofree char *name = message_text(values, "file");
    if (!message_integer(values, "id", 0, G_MAXINT64, &id, error) ||
        (json_object_has_member(values, "exposure_start_us") &&
         !message_integer(values, "exposure_start_us", 0, G_MAXINT64, &start_us, error)))
        return NULL;
    Frame *frame = pgm_take(priv->folder, name, format->width, format->height, format->bits, error);
    if (!frame)
        return NULL;
    frame->shot = priv->shot;
    frame->id = (guint64)id;
    frame->exposure_us = priv->settings.exposure_us;
    frame->exposure_start_us = start_us;
    frame->exposure_end_us = start_us + frame->exposure_us;
    frame->cfa = format->cfa;
    frame->black_level = format->black_level;
    return frame;
}

static void on_answer(const struct program_answer *answer, gpointer data) {
    Camera *camera = data;
    struct program_camera *priv = camera->device.priv;
    if (answer->tag != priv->n_triggers)
        return; /* the trigger of this answer was given up */
    priv->is_asked = FALSE;
    if (!camera_is_waiting(camera))
        return;
    GError *error = answer->error ? g_error_copy(answer->error) : NULL;
    if (error) {
        camera_report_fault(camera, error);
        return;
    }
    Frame *frame = read_frame(camera, answer->values, &error);
    if (frame) {
        camera_report_frame(camera, frame);
        return;
    }
    program_name_error(priv->program, &error);
    camera_report_fault(camera, error);
}

/* Reports a fault if the camera is armed. If a trigger was waiting, on_answer() has already
 * reported a fault, which has disarmed the camera. */
static void on_lost(const GError *error, gboolean answered, gpointer data) {
    Camera *camera = data;
    if (camera_is_armed(camera))
        camera_report_fault(camera, g_error_copy(error));
}

static void on_event(const char *event, JsonObject *values, gpointer data) {
    Camera *camera = data;
    const struct program_camera *priv = camera->device.priv;
    if (g_str_equal(event, "exposed"))
        camera_report_exposed(camera);
    else if (g_str_equal(event, "lost"))
        camera_report_fault(camera, program_lost_error(priv->program, values));
}

gboolean program_camera_configure(Camera *camera, const struct camera_settings *settings,
                                  GError **error) {
    struct program_camera *priv = camera->device.priv;
    if (settings->gain_db != 0 && !program_can(priv->program, "gain"))
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, camera->device.who,
                                "%s cannot set a gain of %g dB" ERROR_ADVICE "use gain_db = 0",
                                priv->command.path, settings->gain_db);
    priv->settings = *settings;
    return TRUE;
}

/* Sends a "ping", which starts a program that has ended. The next trigger then need not wait for
 * the start. */
gboolean program_camera_arm(Camera *camera, GError **error) {
    const struct program_camera *priv = camera->device.priv;
    program_call(priv->program, &(struct program_request){.method = "ping", .tag = -1});
    return TRUE;
}

/* If the program understands "stop", tells it to give up the picture. The program may first end a
 * read-out. */
void program_camera_disarm(Camera *camera) {
    struct program_camera *priv = camera->device.priv;
    program_overtake(priv->program, priv->n_triggers);
    if (!priv->is_asked || !program_can(priv->program, "stop"))
        return;
    priv->is_asked = FALSE;
    const int readout_ms = (int)(camera->format.readout_us / 1000);
    program_call(priv->program,
                 &(struct program_request){.method = "stop",
                                           .timeout_ms = PROGRAM_ANSWER_MS + readout_ms,
                                           .turn = PROGRAM_AT_ONCE,
                                           .tag = -1});
}

gboolean program_camera_trigger(Camera *camera, guint64 shot, GError **error) {
    struct program_camera *priv = camera->device.priv;
    const gint64 wait_us = program_camera_wait_us(&camera->format, priv->settings.exposure_us);
    struct program_request request = {.method = "trigger",
                                      .params = json_object_new(),
                                      .timeout_ms = (int)(wait_us / 1000),
                                      .tag = ++priv->n_triggers};
    json_object_set_int_member(request.params, "shot", (gint64)shot);
    json_object_set_int_member(request.params, "exposure_us", priv->settings.exposure_us);
    json_object_set_double_member(request.params, "gain_db", priv->settings.gain_db);
    priv->shot = shot;
    priv->triggered_us = clock_now_us(camera->device.clock);
    priv->is_asked = TRUE;
    empty_folder(priv);
    program_call(priv->program, &request);
    return TRUE;
}

static gboolean read_time(JsonObject *values, const char *name, gint64 *ret_us, GError **error) {
    double ms = 0;
    if (json_object_has_member(values, name) &&
        !message_number(values, name, 0, MAX_MS, &ms, error))
        return FALSE;
    *ret_us = (gint64)(ms * 1000);
    return TRUE;
}

static gboolean read_format(JsonObject *values, struct camera_format *ret, GError **error) {
    gint64 width, height, bits;
    *ret = (struct camera_format){.stamp_us = -1};
    if (!message_integer(values, "width", 1, MAX_SIDE, &width, error) ||
        !message_integer(values, "height", 1, MAX_SIDE, &height, error) ||
        !message_integer(values, "bits", 1, 16, &bits, error) ||
        !message_number(values, "black_level", 0, 65535, &ret->black_level, error) ||
        !message_integer(values, "min_exposure_us", 1, (gint64)MAX_US, &ret->min_exposure_us,
                         error) ||
        !message_integer(values, "max_exposure_us", ret->min_exposure_us, (gint64)MAX_US,
                         &ret->max_exposure_us, error) ||
        !read_time(values, "trigger_ms", &ret->trigger_us, error) ||
        !read_time(values, "readout_ms", &ret->readout_us, error))
        return FALSE;
    g_autofree char *cfa = message_text(values, "cfa");
    ret->width = (int)width;
    ret->height = (int)height;
    ret->bits = (int)bits;
    if (cfa_parse(cfa, &ret->cfa))
        return TRUE;
    g_set_error(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                "answered cfa = “%s”, which is not mono, rggb, bggr, grbg or gbrg", cfa);
    return FALSE;
}

gboolean program_camera_read_format(JsonObject *values, struct camera_format *ret,
                                    gint64 **ret_exposures_us, GError **error) {
    *ret_exposures_us = NULL;
    if (!read_format(values, ret, error))
        return FALSE;
    if (json_object_has_member(values, "exposures_us") &&
        !message_integers(values, "exposures_us", 1, (gint64)MAX_US, ret_exposures_us,
                          &ret->n_exposures, error))
        return FALSE;
    ret->exposures_us = *ret_exposures_us;
    return TRUE;
}

gint64 program_camera_wait_us(const struct camera_format *format, gint64 exposure_us) {
    return format->trigger_us + exposure_us + READOUTS * format->readout_us +
           PROGRAM_ANSWER_MS * (gint64)1000;
}

void program_camera_close(Camera *camera) {
    struct program_camera *priv = camera->device.priv;
    g_clear_pointer(&priv->program, program_close);
    g_clear_pointer(&priv->exposures_us, g_free);
    if (!priv->folder)
        return;
    empty_folder(priv);
    g_rmdir(priv->folder);
    g_clear_pointer(&priv->folder, g_free);
}

gboolean program_camera_open(Camera *camera, GError **error) {
    struct program_camera *priv = camera->device.priv;
    g_autoptr(GError) why = NULL;
    priv->folder = g_dir_make_tmp("mesorig-program-XXXXXX", &why);
    if (!priv->folder)
        return device_error_set(
            error, DEVICE_ERROR_DISCONNECTED, camera->device.who,
            "the folder for the pictures of its program cannot be made: %s" ERROR_ADVICE
            "free space in the folder for temporary files",
            why->message);
    priv->program = program_new(&priv->command, &camera->device, priv->folder, error);
    if (priv->program)
        return TRUE;
    program_camera_close(camera);
    return FALSE;
}

gboolean program_camera_opened(Camera *camera, GError **error) {
    struct program_camera *priv = camera->device.priv;
    const struct program_listener listener = {on_lost, on_event, on_answer, camera};
    JsonObject *values = program_await(priv->program, error);
    if (!values)
        return FALSE;
    g_clear_pointer(&priv->exposures_us, g_free);
    if (!program_camera_read_format(values, &camera->format, &priv->exposures_us, error)) {
        program_name_error(priv->program, error);
        return FALSE;
    }
    program_listen(priv->program, &listener);
    return TRUE;
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    program_check(&((const struct program_camera *)given)->command, section, mistakes);
}

static void needs(gconstpointer given, GPtrArray *to) {
    program_need(&((const struct program_camera *)given)->command, to);
}

const struct camera_driver program_camera_driver = {
    .info = {"camera", "program-camera",
             "A camera that a program of yours triggers (docs/build-a-rig/programs.md)", options,
             sizeof(struct program_camera), check, needs},
    .open = program_camera_open,
    .opened = program_camera_opened,
    .close = program_camera_close,
    .configure = program_camera_configure,
    .arm = program_camera_arm,
    .disarm = program_camera_disarm,
    .trigger = program_camera_trigger,
    .no_stamps = TRUE,
};
