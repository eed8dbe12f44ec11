/* Lamps that a program switches. "set" switches one lamp, and "stop" switches all lamps off.
 * "get" follows each of them, and its answer confirms the new state. */
#include "devices.h"
#include "message.h"
#include "program.h"

#define MAX_LAMPS 1024
#define CLOSE_MS  500 /* longest time that close() waits for the answer to each request */

struct program_lamps {
    struct program_command command;
    double warm_up_s;
    Program *program;
    gboolean *on; /* buffer for the n states of an answer */
};

#define FIELD(name) G_STRUCT_OFFSET(struct program_lamps, name)

static const struct option options[] = {
    PROGRAM_OPTIONS(FIELD(command)),
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, FIELD(warm_up_s),
     "Time from switching on until the output is stable"},
    {NULL},
};

/* Returns the tag of a request that switches a lamp, or all lamps if index is −1. */
static int tag_of(int index, gboolean on) {
    return 2 * (index + 1) + (on != FALSE);
}

/* Fails unless the program's answer says that lamp `index` is in the wanted state, or every lamp if
 * index is −1. */
static gboolean check_lamps(const LampBank *bank, JsonObject *values, int index, gboolean on,
                            GError **error) {
    const struct program_lamps *lamps = bank->device.priv;
    if (!message_booleans(values, "on", bank->n, lamps->on, error)) {
        program_name_error(lamps->program, error);
        return FALSE;
    }
    for (int i = 0; i < bank->n; i++)
        if ((index < 0 || i == index) && lamps->on[i] != on)
            return device_error_set(error, DEVICE_ERROR_PROTOCOL, bank->device.who,
                                    "lamp %d was switched %s, but %s reports that this lamp is "
                                    "%s" ERROR_ADVICE "check the lamp's power",
                                    i, on ? "on" : "off", lamps->command.path, on ? "off" : "on");
    return TRUE;
}

static void on_answer(const struct program_answer *answer, gpointer data) {
    LampBank *bank = data;
    const int index = answer->tag / 2 - 1;
    const gboolean on = answer->tag % 2;
    GError *error = answer->error ? g_error_copy(answer->error) : NULL;
    if (!error)
        check_lamps(bank, answer->values, index, on, &error);
    if (error && answer->overtaken) {
        g_clear_error(&error);
        error = device_error_new(
            DEVICE_ERROR_BUSY, bank->device.who,
            "“on” of lamp %d was given up, because “off” came before the lamp was on", index);
    }
    lamps_report(bank, index, on, error);
}

/* If requests have failed because of the loss (answered), the class itself repeats "off" for the
 * lamps of these requests (lights.h). If no request has failed, or if a lamp is still LIGHT_ON,
 * reports the lamps as lost. */
static void on_lost(const GError *error, gboolean answered, gpointer data) {
    LampBank *bank = data;
    gboolean any = !answered;
    for (int i = 0; i < bank->n; i++)
        any |= lamps_light(bank, i) == LIGHT_ON;
    if (any)
        lamps_lost(bank, g_error_copy(error));
}

static void on_event(const char *event, JsonObject *values, gpointer data) {
    LampBank *bank = data;
    const struct program_lamps *lamps = bank->device.priv;
    if (g_str_equal(event, "lost"))
        lamps_lost(bank, program_lost_error(lamps->program, values));
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    const struct program_lamps *lamps = bank->device.priv;
    struct program_request request = {.method = index < 0 ? "stop" : "set",
                                      .turn = on          ? PROGRAM_IN_TURN
                                              : index < 0 ? PROGRAM_AT_ONCE
                                                          : PROGRAM_FIRST,
                                      .read_back = TRUE,
                                      .tag = tag_of(index, on)};
    for (int i = 0; i < bank->n && !on; i++)
        if (index < 0 || i == index)
            program_overtake(lamps->program, tag_of(i, TRUE));
    if (index >= 0) {
        request.params = json_object_new();
        json_object_set_int_member(request.params, "index", index);
        json_object_set_boolean_member(request.params, "on", on);
    }
    program_call(lamps->program, &request);
    return TRUE;
}

/* Switches all lamps off and waits until "stop" and "get" are answered. Each may take
 * timeout_ms, or PROGRAM_ANSWER_MS if it is 0. */
static gboolean all_off(LampBank *bank, int timeout_ms, GError **error) {
    const struct program_lamps *lamps = bank->device.priv;
    const struct program_request request = {"stop", NULL, timeout_ms, PROGRAM_AT_ONCE, TRUE};
    g_autoptr(JsonObject) values = program_ask(lamps->program, &request, error);
    return values && check_lamps(bank, values, -1, FALSE, error);
}

static void leave(struct program_lamps *lamps) {
    g_clear_pointer(&lamps->program, program_close);
    g_clear_pointer(&lamps->on, g_free);
}

static gboolean open_lamps(LampBank *bank, GError **error) {
    struct program_lamps *lamps = bank->device.priv;
    const struct program_listener listener = {on_lost, on_event, on_answer, bank};
    gint64 n;
    lamps->program = program_new(&lamps->command, &bank->device, NULL, error);
    if (!lamps->program)
        return FALSE;
    JsonObject *opened = program_await(lamps->program, error);
    if (opened && !message_integer(opened, "lamps", 1, MAX_LAMPS, &n, error)) {
        program_name_error(lamps->program, error);
        opened = NULL;
    }
    if (opened) {
        bank->n = (int)n;
        bank->warm_up_s = lamps->warm_up_s;
        bank->watchdog_s = program_can(lamps->program, "silence") ? PROGRAM_SILENCE_MS / 1000.0 : 0;
        lamps->on = g_new0(gboolean, n);
    }
    if (!opened || !all_off(bank, 0, error)) {
        leave(lamps);
        return FALSE;
    }
    program_listen(lamps->program, &listener);
    return TRUE;
}

static void close_lamps(LampBank *bank) {
    struct program_lamps *lamps = bank->device.priv;
    program_listen(lamps->program, NULL);
    all_off(bank, CLOSE_MS, NULL);
    leave(lamps);
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    program_check(&((const struct program_lamps *)given)->command, section, mistakes);
}

static void needs(gconstpointer given, GPtrArray *to) {
    program_need(&((const struct program_lamps *)given)->command, to);
}

const struct lamps_driver program_lamps_driver = {
    .info = {"lamps", "program-lamps",
             "Lamps that a program of yours switches (docs/build-a-rig/programs.md)", options,
             sizeof(struct program_lamps), check, needs},
    .open = open_lamps,
    .close = close_lamps,
    .set = set_lamp,
};
