#include "output.h"

#define DEADLINE_US (2 * G_USEC_PER_SEC)

/* Pauses between two attempts to switch off. The longest leaves time to reach a device within a
 * second of its return, also on a line that first waits for late answers. */
#define FIRST_PAUSE_US 100000
#define MAX_PAUSE_US   300000

struct command {
    struct outputs *outputs;
    guint64 number; /* counts the commands of all outputs */
    int index;
    gboolean on;
    gboolean retry;   /* sent by the class; nobody waits for its answer */
    gboolean overdue; /* not answered in time; its answer may still come */
    guint deadline;
};

struct output {
    gboolean wanted; /* on */
    gboolean dark;   /* the last "off" was confirmed, and no "on" was sent since */
    gboolean failed; /* a command has failed, and neither "off" nor a wanted "on" was confirmed
                        since */
    gboolean lit;    /* "on" was confirmed, and "off" was not since */
    guint64 on_number, off_number; /* the last command of each kind */
    gint64 since_us, burnt_us, confirmed_us;
};

struct outputs {
    struct device *device;
    OutputsSend send;
    OutputsAnswer answer;
    gboolean many;
    guint64 n_commands;
    GQueue commands; /* of struct command, in order, until they are answered */
    guint retry;
    gint64 pause_us; /* before the next attempt */
    int n, turn;     /* turn: the output that is tried next */
    struct output *list;
};

static void command_free(gpointer data) {
    struct command *command = data;
    clock_cancel(command->outputs->device->clock, &command->deadline);
    g_free(command);
}

struct outputs *outputs_new(gpointer device, int n, gboolean many, OutputsSend send,
                            OutputsAnswer answer) {
    struct outputs *outputs = g_new0(struct outputs, 1);
    *outputs = (struct outputs){.device = device,
                                .send = send,
                                .answer = answer,
                                .many = many,
                                .n = n,
                                .list = g_new0(struct output, n)};
    for (int i = 0; i < n; i++) {
        outputs->list[i].dark = TRUE; /* the driver's open() has switched it off */
        outputs->list[i].confirmed_us = clock_now_us(outputs->device->clock);
    }
    return outputs;
}

void outputs_free(struct outputs *outputs) {
    if (!outputs)
        return;
    clock_cancel(outputs->device->clock, &outputs->retry);
    g_queue_clear_full(&outputs->commands, command_free);
    g_free(outputs->list);
    g_free(outputs);
}

static gboolean covers(const struct command *command, int i) {
    return command->index < 0 || command->index == i;
}

/* Whether an "off" was sent after the output's last "on" and may still be answered in time. */
static gboolean off_is_due(const struct outputs *outputs, int i) {
    for (const GList *l = outputs->commands.head; l; l = l->next) {
        const struct command *command = l->data;
        if (!command->on && !command->overdue && covers(command, i) &&
            command->number > outputs->list[i].on_number)
            return TRUE;
    }
    return FALSE;
}

static gboolean must_go_off(const struct outputs *outputs, int i) {
    return outputs->list[i].failed && !outputs->list[i].wanted;
}

static gboolean any_failed(const struct outputs *outputs) {
    for (int i = 0; i < outputs->n; i++)
        if (outputs->list[i].failed)
            return TRUE;
    return FALSE;
}

static void took_off(struct output *output, const struct command *command, gint64 now,
                     gboolean failed) {
    const gboolean on_again = output->on_number > command->number;
    if (failed) {
        output->dark = output->dark && on_again;
        output->failed |= !on_again;
        return;
    }
    if (output->lit)
        output->burnt_us += now - output->since_us;
    output->lit = FALSE;
    output->confirmed_us = now;
    if (!on_again) {
        output->dark = TRUE;
        output->failed = FALSE;
    }
}

/* off_due: an "off" that is under way decides, and not this "on". */
static void took_on(struct output *output, const struct command *command, gint64 now,
                    gboolean failed, gboolean off_due) {
    const gboolean last = output->on_number == command->number;
    if (!failed) {
        output->dark = FALSE;
        output->confirmed_us = now;
        if (!output->lit)
            output->since_us = now;
        output->lit = TRUE;
    }
    if (failed && last)
        output->wanted = FALSE;
    if (output->wanted)
        output->failed &= failed || !last;
    else
        output->failed |= !off_due;
}

static void outputs_retry(gpointer data);

/* Tells whether the device is safe, and sees to it that what should be off is tried again. */
static void outputs_settle(struct outputs *outputs, const GError *error) {
    gboolean due = FALSE;
    for (int i = 0; i < outputs->n; i++)
        due |= must_go_off(outputs, i) && !off_is_due(outputs, i);
    if (!any_failed(outputs)) {
        outputs->pause_us = 0;
        device_report_safety(outputs->device, NULL);
    } else if (error) {
        device_report_safety(outputs->device, error);
    }
    if (due && outputs->retry == 0)
        outputs->retry =
            clock_call_in(outputs->device->clock, outputs->pause_us, outputs_retry, outputs);
}

/* What the answer to a command, or its lack, says about the outputs. */
static void outputs_take(struct outputs *outputs, const struct command *command,
                         const GError *error) {
    const gint64 now = clock_now_us(outputs->device->clock);
    if (!error && !command->on)
        outputs->pause_us = 0;
    else if (!command->on)
        outputs->pause_us =
            outputs->pause_us ? MIN(2 * outputs->pause_us, MAX_PAUSE_US) : FIRST_PAUSE_US;
    for (int i = 0; i < outputs->n; i++) {
        if (covers(command, i) && command->on)
            took_on(&outputs->list[i], command, now, error != NULL, off_is_due(outputs, i));
        else if (covers(command, i))
            took_off(&outputs->list[i], command, now, error != NULL);
    }
    outputs_settle(outputs, error);
}

/* An answer that still comes to one of several commands to switch off, with no "on" between them,
 * proves as much whichever it belongs to: keeps the last one of them. */
static void forget_older(struct outputs *outputs, const struct command *command) {
    GList *l = g_queue_find(&outputs->commands, command);
    for (l = l ? l->prev : NULL; l; l = l->prev) {
        struct command *older = l->data;
        if (older->on || !older->overdue)
            return;
        if (older->index == command->index) {
            g_queue_delete_link(&outputs->commands, l);
            command_free(older);
            return;
        }
    }
}

static void outputs_on_deadline(gpointer data) {
    struct command *command = data;
    struct outputs *outputs = command->outputs;
    struct device *device = outputs->device;
    const struct command copy = *command;
    g_autofree char *which = copy.index < 0  ? g_strdup("all lamps ")
                             : outputs->many ? g_strdup_printf("lamp %d ", copy.index)
                                             : g_strdup("");
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, device->who, "%sdid not answer to \"%s\" within %d s%s", which,
        copy.on ? "on" : "off", (int)(DEADLINE_US / G_USEC_PER_SEC),
        copy.on || outputs->many ? ERROR_ADVICE "check its cable and power"
                                 : ERROR_ADVICE "it may still shine: cut its power by hand");
    command->deadline = 0;
    command->overdue = TRUE;
    if (!copy.on)
        forget_older(outputs, command);
    outputs_take(outputs, &copy, error);
    if (!copy.retry)
        outputs->answer(device, copy.index, copy.on, error);
}

/* FALSE: the device has refused; nobody is to be answered. */
static gboolean outputs_command(struct outputs *outputs, int index, gboolean on, gboolean retry,
                                GError **error) {
    struct command *command = g_new0(struct command, 1);
    *command = (struct command){outputs, ++outputs->n_commands, index, on, retry};
    for (int i = 0; i < outputs->n; i++) {
        struct output *output = &outputs->list[i];
        if (!covers(command, i))
            continue;
        output->wanted = on;
        if (on)
            output->dark = FALSE;
        *(on ? &output->on_number : &output->off_number) = command->number;
    }
    g_queue_push_tail(&outputs->commands, command);
    GError *failed = NULL;
    if (outputs->send(outputs->device, index, on, &failed)) {
        command->deadline =
            clock_call_in(outputs->device->clock, DEADLINE_US, outputs_on_deadline, command);
        return TRUE;
    }
    if (!failed)
        failed = device_error_new(DEVICE_ERROR_PROTOCOL, outputs->device->who, "refused");
    g_queue_remove(&outputs->commands, command);
    outputs_take(outputs, command, failed);
    command_free(command);
    g_propagate_error(error, failed);
    return FALSE;
}

/* One command at a time: for all outputs, unless others are wanted. */
static void outputs_retry(gpointer data) {
    struct outputs *outputs = data;
    int first = -1, n_wanted = 0;
    outputs->retry = 0;
    for (int k = 0; k < outputs->n; k++) {
        const int i = (outputs->turn + k) % outputs->n;
        n_wanted += outputs->list[i].wanted;
        if (first < 0 && must_go_off(outputs, i) && !off_is_due(outputs, i))
            first = i;
    }
    for (const GList *l = outputs->commands.head; l; l = l->next) {
        const struct command *command = l->data;
        if (command->retry && !command->overdue)
            return; /* its end continues */
    }
    if (first < 0)
        return;
    outputs->turn = (first + 1) % outputs->n;
    outputs_command(outputs, outputs->many && n_wanted == 0 ? -1 : first, FALSE, TRUE, NULL);
}

gboolean outputs_set(struct outputs *outputs, int index, gboolean on, GError **error) {
    return outputs_command(outputs, index, on, FALSE, error);
}

/* Devices answer in order, so that commands before one that is answered stay without an answer. The
 * first that fits is taken: at worst an answer then proves less than it could. */
static struct command *find_command(const struct outputs *outputs, int index, gboolean on) {
    for (const GList *l = outputs->commands.head; l; l = l->next) {
        struct command *command = l->data;
        if (command->index == index && command->on == on)
            return command;
        if (!command->overdue)
            return NULL;
    }
    return NULL;
}

/* Light that nobody asked for. */
static void believe(struct outputs *outputs, int index) {
    const struct command unknown = {.index = index, .on = TRUE};
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_PROTOCOL, outputs->device->who,
        "it reports light that nobody has asked for" ERROR_ADVICE "see what else switches it");
    outputs_take(outputs, &unknown, NULL);
    outputs_settle(outputs, error);
}

void outputs_report(struct outputs *outputs, int index, gboolean on, const GError *error) {
    struct command *command = find_command(outputs, index, on);
    if (!command) {
        if (!error && on && index >= 0 && index < outputs->n)
            believe(outputs, index);
        return;
    }
    while (outputs->commands.head->data != command)
        command_free(g_queue_pop_head(&outputs->commands));
    g_queue_pop_head(&outputs->commands);
    const gboolean heard = !command->retry && !command->overdue;
    if (!command->overdue || !error)
        outputs_take(outputs, command, error);
    command_free(command);
    if (heard)
        outputs->answer(outputs->device, index, on, error);
}

void outputs_lost(struct outputs *outputs, const GError *error) {
    g_autoptr(GError) unsent = NULL;
    for (int i = 0; i < outputs->n; i++) {
        outputs->list[i].wanted = outputs->list[i].dark = FALSE;
        outputs->list[i].failed = TRUE;
    }
    device_report_safety(outputs->device, error);
    outputs_set(outputs, outputs->many ? -1 : 0, FALSE, &unsent);
}

enum light outputs_light(const struct outputs *outputs, int index) {
    return outputs->list[index].dark     ? LIGHT_OFF
           : must_go_off(outputs, index) ? LIGHT_UNSAFE
                                         : LIGHT_ON;
}

enum device_safety outputs_safety(const struct outputs *outputs) {
    gboolean dark = TRUE, due = FALSE;
    for (int i = 0; i < outputs->n; i++)
        dark &= outputs->list[i].dark;
    for (const GList *l = outputs->commands.head; l; l = l->next)
        due |= !((const struct command *)l->data)->overdue;
    return any_failed(outputs) ? DEVICE_UNSAFE
           : due               ? DEVICE_TOLD
           : dark              ? DEVICE_SAFE
                               : DEVICE_UNSAFE;
}

gint64 outputs_confirmed_us(const struct outputs *outputs, int index) {
    return outputs->list[index].confirmed_us;
}

gint64 outputs_since_us(const struct outputs *outputs, int index) {
    return outputs->list[index].lit ? outputs->list[index].since_us : -1;
}

gint64 outputs_burnt_us(const struct outputs *outputs, int index) {
    const struct output *output = &outputs->list[index];
    return output->burnt_us +
           (output->lit ? clock_now_us(outputs->device->clock) - output->since_us : 0);
}
