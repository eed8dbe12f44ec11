#include <gio/gio.h>
#include <string.h>

#include "unattended.h"

#define MAX_SESSIONS 100 /* maximum number of sessions in one call */

static char *output, *folder, *calibration;
static gboolean process, yes, ended;

static const GOptionEntry add_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "Session directory to make, if only one session is added", "DIR"},
    {"into", 0, 0, G_OPTION_ARG_FILENAME, &folder,
     "Folder for the session directories, NAME.session for NAME.conf (the current folder)", "DIR"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration,
     "Use this calibration instead of the one that the rig file names", "FILE"},
    {"process", 0, 0, G_OPTION_ARG_NONE, &process, "Process the frames while they are captured",
     NULL},
    {"yes", 0, 0, G_OPTION_ARG_NONE, &yes, "Capture even if test shots give warnings", NULL},
    {NULL},
};

static const GOptionEntry remove_entries[] = {
    {"ended", 0, 0, G_OPTION_ARG_NONE, &ended, "Remove all sessions that are done or have stopped",
     NULL},
    {NULL},
};

/* Finds a daemon that keeps a queue. Returns NULL with an error if there is none. */
static Link *queue_link(GError **error) {
    g_autoptr(Link) link = link_find(NULL, error);
    if (!link)
        return NULL;
    if (g_strcmp0(bus_rig1_get_queue_state(link_rig(link)), "none") != 0)
        return g_steal_pointer(&link);
    const char *why = bus_rig1_get_queue_reason(link_rig(link));
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_SUPPORTED, "this mesorigd keeps no queue: %s",
                why && *why ? why : "start it with --queue FILE, as the system service does");
    return NULL;
}

/* Returns the session directory into which a session file is to be captured; g_free(). */
static char *directory_for(const char *session) {
    if (output)
        return g_canonicalize_filename(output, NULL);
    g_autofree char *name = g_path_get_basename(session);
    if (g_str_has_suffix(name, ".conf"))
        name[strlen(name) - strlen(".conf")] = '\0';
    g_autofree char *file = g_strconcat(name, ".session", NULL);
    g_autofree char *below = g_build_filename(folder ? folder : ".", file, NULL);
    return g_canonicalize_filename(below, NULL);
}

/* Returns the options of the request that adds a session or, if check is TRUE, that validates it.
 * Returns NULL with an error if a file cannot be read. */
static GVariant *add_options(Link *link, const char *session, gboolean check, GError **error) {
    g_autofree char *path = calibration ? g_canonicalize_filename(calibration, NULL) : NULL;
    g_auto(GVariantDict) options;
    g_variant_dict_init(&options, NULL);
    if (!link_add_text(link, &options, "session_text", session, error) ||
        (path && !check && !link_add_text(link, &options, "calibration_text", path, error)))
        return NULL;
    if (!check) {
        g_variant_dict_insert(&options, "process", "b", process);
        g_variant_dict_insert(&options, "yes", "b", yes);
        if (path)
            g_variant_dict_insert(&options, "calibration", "s", path);
    }
    return g_variant_dict_end(&options);
}

/* Checks all session files before the first one is added. If there are mistakes, returns FALSE with
 * one error that lists them all. */
static gboolean check_all(Link *link, const struct call *call, GError **error) {
    g_autoptr(GString) mistakes = g_string_new(NULL);
    for (int i = 0; i < call->n_arguments; i++) {
        g_autofree char *session = g_canonicalize_filename(call->arguments[i], NULL);
        g_autofree char *directory = directory_for(session), *text = NULL;
        g_autoptr(GError) why = NULL;
        g_autoptr(GVariant) plan = NULL;
        gboolean ok = FALSE;
        GVariant *options = add_options(link, session, TRUE, &why);
        if (options && !bus_rig1_call_validate_sync(link_rig(link), session, directory, options,
                                                    &ok, &text, &plan, NULL, &why))
            g_dbus_error_strip_remote_error(why);
        if (!ok)
            g_string_append_printf(mistakes, "%s%s", mistakes->len ? "\n" : "",
                                   why ? why->message : text);
    }
    if (mistakes->len)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA, "nothing was added:\n%s",
                    mistakes->str);
    return mistakes->len == 0;
}

static int run_add(const struct call *call, GError **error) {
    if (output && folder)
        return cli_usage(call->command, "give -o or --into, not both");
    if (output && call->n_arguments > 1)
        return cli_usage(call->command,
                         "-o names the directory of a single session: give --into DIR for several");
    g_autoptr(Link) link = queue_link(error);
    if (!link || (call->n_arguments > 1 && !check_all(link, call, error)))
        return CLI_FAILED;
    record_begin_list(call->record, "added");
    for (int i = 0; i < call->n_arguments; i++) {
        g_autofree char *session = g_canonicalize_filename(call->arguments[i], NULL);
        g_autofree char *directory = directory_for(session);
        g_autoptr(GVariant) plan = NULL;
        guint number = 0;
        GVariant *options = add_options(link, session, FALSE, error);
        if (!options || !bus_rig1_call_queue_add_sync(link_rig(link), session, directory, options,
                                                      &number, &plan, NULL, error)) {
            if (i > 0)
                g_prefix_error(error, "sessions added: %d; the next one was not added: ", i);
            return CLI_FAILED;
        }
        record_begin(call->record, NULL);
        record_say(call->record, "added as number %u{number}: %s{directory}\n", number, directory);
        record_variant(call->record, "plan", plan);
        record_end(call->record);
    }
    record_end(call->record);
    const char *state = bus_rig1_get_queue_state(link_rig(link));
    const char *reason = bus_rig1_get_queue_reason(link_rig(link));
    if (g_strcmp0(state, "paused") == 0)
        record_say(call->record, "the queue is paused: %s; “mesorig queue resume” continues it\n",
                   reason);
    return CLI_DONE;
}

static int run_list(const struct call *call, GError **error) {
    g_autoptr(Link) link = queue_link(error);
    if (!link)
        return CLI_FAILED;
    unattended_tell(call->record, link_rig(link), TRUE);
    return CLI_DONE;
}

#define SESSION_HINT "“mesorig queue list” shows the sessions' numbers"

/* Parses a number from 1 on. Returns FALSE with an error for other texts. The error ends with
 * `hint`, which says where the user finds the number. */
static gboolean parse_number(const char *text, const char *hint, guint *ret, GError **error) {
    guint64 value;
    if (!g_ascii_string_to_unsigned(text, 10, 1, G_MAXUINT, &value, NULL)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "“%s” is not a number from 1 on; %s", text, hint);
        return FALSE;
    }
    *ret = (guint)value;
    return TRUE;
}

static gboolean remove_one(const struct call *call, BusRig1 *rig, guint number, GError **error) {
    if (!bus_rig1_call_queue_remove_sync(rig, number, NULL, error))
        return FALSE;
    record_say(call->record, "removed: %u\n", number);
    return TRUE;
}

static gboolean remove_ended(const struct call *call, BusRig1 *rig, GError **error) {
    g_autoptr(GVariant) items = g_variant_ref(bus_rig1_get_queue(rig));
    for (gsize i = 0; i < g_variant_n_children(items); i++) {
        g_autoptr(GVariant) item = g_variant_get_child_value(items, i);
        const char *state = "";
        guint number = 0;
        g_variant_lookup(item, "state", "&s", &state);
        g_variant_lookup(item, "number", "u", &number);
        if ((strcmp(state, "done") == 0 || strcmp(state, "stopped") == 0) &&
            !remove_one(call, rig, number, error))
            return FALSE;
    }
    return TRUE;
}

static int run_remove(const struct call *call, GError **error) {
    if ((call->n_arguments == 0) != ended)
        return cli_usage(call->command, "give numbers of sessions or --ended, not both");
    g_autoptr(Link) link = queue_link(error);
    if (!link || (ended && !remove_ended(call, link_rig(link), error)))
        return CLI_FAILED;
    for (int i = 0; i < call->n_arguments; i++) {
        guint number;
        if (!parse_number(call->arguments[i], SESSION_HINT, &number, error) ||
            !remove_one(call, link_rig(link), number, error))
            return CLI_FAILED;
    }
    record_string(call->record, "done", "remove");
    return CLI_DONE;
}

static int run_move(const struct call *call, GError **error) {
    guint number, place;
    if (!parse_number(call->arguments[0], SESSION_HINT, &number, error) ||
        !parse_number(call->arguments[1], "give the place in the queue, 1 for the first", &place,
                      error))
        return CLI_FAILED;
    g_autoptr(Link) link = queue_link(error);
    if (!link || !bus_rig1_call_queue_move_sync(link_rig(link), number, place, NULL, error))
        return CLI_FAILED;
    record_string(call->record, "done", "move");
    record_say(call->record, "moved to place %u\n", place);
    return CLI_DONE;
}

static int run_pause(const struct call *call, GError **error) {
    g_autoptr(Link) link = queue_link(error);
    if (!link || !bus_rig1_call_queue_pause_sync(link_rig(link), NULL, error))
        return CLI_FAILED;
    record_string(call->record, "done", "pause");
    record_say(call->record, "no further session begins; a capture that is under way continues "
                             "(“mesorig pause” pauses it)\n");
    return CLI_DONE;
}

static int run_resume(const struct call *call, GError **error) {
    g_autoptr(Link) link = queue_link(error);
    if (!link || !bus_rig1_call_queue_resume_sync(link_rig(link), NULL, error))
        return CLI_FAILED;
    record_string(call->record, "done", "resume");
    record_say(call->record, "the queue continues\n");
    return CLI_DONE;
}

static const struct command queue_add = {
    .name = "queue add",
    .arguments = "SESSION...",
    .examples = "  mesorig queue add weave.conf felt.conf --into /var/lib/mesorig\n"
                "  mesorig queue add weave.conf -o /var/lib/mesorig/weave.session --process\n",
    .help = "Check sessions, and add them at the end of the queue.",
    .options = add_entries,
    .daemon = TRUE,
    .min = 1,
    .max = MAX_SESSIONS,
    .run = run_add};
static const struct command queue_list = {
    .name = "queue list",
    .arguments = "",
    .examples = "  mesorig queue list\n",
    .help = "Show the queue, and when its sessions begin and end.",
    .daemon = TRUE,
    .run = run_list};
static const struct command queue_remove = {
    .name = "queue remove",
    .arguments = "NUMBER...",
    .examples = "  mesorig queue remove 3\n"
                "  mesorig queue remove --ended\n",
    .help = "Remove sessions that are not being captured; their directories stay.",
    .options = remove_entries,
    .daemon = TRUE,
    .max = MAX_SESSIONS,
    .run = run_remove};
static const struct command queue_move = {
    .name = "queue move",
    .arguments = "NUMBER PLACE",
    .examples = "  mesorig queue move 5 1\n",
    .help = "Move a session to another place among the waiting sessions.",
    .daemon = TRUE,
    .min = 2,
    .max = 2,
    .run = run_move};
static const struct command queue_pause = {
    .name = "queue pause",
    .arguments = "",
    .examples = "  mesorig queue pause\n",
    .help = "Begin no further session; a capture that is under way continues.",
    .daemon = TRUE,
    .run = run_pause};
static const struct command queue_resume = {
    .name = "queue resume",
    .arguments = "",
    .examples = "  mesorig queue resume\n",
    .help = "Continue the queue, and its session if the session is paused.",
    .daemon = TRUE,
    .run = run_resume};

static const struct command *const commands[] = {
    &queue_add, &queue_list, &queue_remove, &queue_move, &queue_pause, &queue_resume, NULL};

/* Runs a command of `mesorig queue`. The command may also be the one that only the daemon uses. */
static int run_queue(const struct command *command, int argc, char **argv) {
    return argc > 1 && strcmp(argv[1], "try") == 0 ? cli_run(&unattended_try, argc - 1, argv + 1)
                                                   : cli_run_child(command, argc, argv);
}

const struct command unattended_queue = {
    .name = "queue",
    .arguments = "WHAT …",
    .examples = "  mesorig queue add weave.conf felt.conf --into /var/lib/mesorig\n"
                "  mesorig queue list\n",
    .help = "Capture sessions one after the other, without an operator.",
    .run_arguments = run_queue,
    .children = commands};
