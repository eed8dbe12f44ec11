#include <gio/gunixinputstream.h>
#include <string.h>
#include <unistd.h>

#include "drivers/device.h"
#include "hands/before_capture.h"
#include "unattended.h"

#define EXIT_RIG 3

/* Reads the request from standard input. The request is a key file that daemon/bus/bus_trial.c
 * writes. Returns NULL with an error if it cannot be read. */
static GKeyFile *read_request(GError **error) {
    g_autoptr(GInputStream) from = g_unix_input_stream_new(STDIN_FILENO, FALSE);
    g_autoptr(GOutputStream) to = g_memory_output_stream_new_resizable();
    g_autoptr(GKeyFile) request = g_key_file_new();
    if (g_output_stream_splice(to, from, G_OUTPUT_STREAM_SPLICE_CLOSE_TARGET, NULL, error) < 0)
        return NULL;
    g_autoptr(GBytes) bytes = g_memory_output_stream_steal_as_bytes(G_MEMORY_OUTPUT_STREAM(to));
    return g_key_file_load_from_bytes(request, bytes, G_KEY_FILE_NONE, error)
               ? g_steal_pointer(&request)
               : NULL;
}

static char *filled(char *text) {
    if (!text || *text)
        return text;
    g_free(text);
    return NULL;
}

/* Returns whether an error is caused by the rig, and not by the session. */
static gboolean is_of_the_rig(const GError *error) {
    static const int codes[] = {DEVICE_ERROR_TIMEOUT, DEVICE_ERROR_DISCONNECTED,
                                DEVICE_ERROR_STALLED, DEVICE_ERROR_INTERLOCK,
                                DEVICE_ERROR_PROTOCOL};
    for (gsize i = 0; i < G_N_ELEMENTS(codes); i++)
        if (g_error_matches(error, DEVICE_ERROR, codes[i]))
            return TRUE;
    return FALSE;
}

static int run_try(const struct call *call, GError **error) {
    g_autoptr(GKeyFile) request = read_request(error);
    g_autoptr(Link) link = request ? link_find(NULL, error) : NULL;
    g_autoptr(GError) why = NULL;
    g_autofree char *chosen = NULL;
    if (!link)
        return CLI_FAILED;
    const char *group = "try";
    g_autofree char *session = g_key_file_get_string(request, group, "session", error);
    g_autofree char *text =
        session ? g_key_file_get_string(request, group, "session_text", error) : NULL;
    if (!text)
        return CLI_FAILED;
    g_autofree char *calibration =
        filled(g_key_file_get_string(request, group, "calibration", NULL));
    g_autofree char *calibration_text =
        filled(g_key_file_get_string(request, group, "calibration_text", NULL));
    const struct before_capture before = {.rig_path = bus_rig1_get_rig_path(link_rig(link)),
                                          .session = session,
                                          .session_text = text,
                                          .calibration = calibration,
                                          .calibration_text = calibration_text,
                                          .yes =
                                              g_key_file_get_boolean(request, group, "yes", NULL)};
    if (before_capture(link, &before, &chosen, &why)) {
        g_print("%s", chosen ? chosen : "");
        return CLI_DONE;
    }
    const gboolean rig = is_of_the_rig(why);
    g_dbus_error_strip_remote_error(why);
    g_printerr("mesorig: %s\n", why->message);
    return rig ? EXIT_RIG : CLI_FAILED;
}

const struct command unattended_try = {
    .name = "queue try",
    .arguments = "",
    .examples = "  mesorig queue try\n",
    .help = "For mesorigd itself: test shots before a session of the queue.",
    .daemon = TRUE,
    .run = run_try};
