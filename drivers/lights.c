#include "lights.h"

#define DEADLINE_US (2 * G_USEC_PER_SEC)

/* Pauses between two attempts to switch off. The longest is short enough to reach a device within a
 * second of its return, even on a line that first waits for late answers. */
#define FIRST_PAUSE_US 100000
#define MAX_PAUSE_US   300000

struct command {
    struct lights *lights;
    guint64 number; /* counts the commands of all lights */
    int index;
    gboolean on;
    gboolean retry;   /* sent by the class, so nobody waits for its answer */
    gboolean overdue; /* not answered in time, but its answer may still come */
    guint deadline;
};

struct light_output {
    gboolean wanted; /* the light should be on */
    gboolean dark;   /* the last "off" was confirmed, and no "on" was sent since */
    /* A command has failed, and neither "off" nor a wanted "on" was confirmed since. */
    gboolean failed;
    guint64 on_number, off_number; /* numbers of the last "on" and the last "off" */
};

struct lights {
    struct device *device;
    LightsSend send;
    LightsAnswer answer;
    gboolean many;
    guint64 n_commands;
    GQueue commands; /* of struct command, in order, until they are answered */
    guint retry;
    gint64 pause_us; /* pause before the next attempt */
    int n, turn;     /* number of outputs, and number of the output that is tried next */
    struct light_output *list;
};

static void command_free(gpointer data) {
    struct command *command = data;
    clock_cancel(command->lights->device->clock, &command->deadline);
    g_free(command);
}

struct lights *lights_new(gpointer device, int n, gboolean many, LightsSend send,
                          LightsAnswer answer) {
    struct lights *lights = g_new0(struct lights, 1);
    *lights = (struct lights){.device = device,
                              .send = send,
                              .answer = answer,
                              .many = many,
                              .n = n,
                              .list = g_new0(struct light_output, n)};
    for (int i = 0; i < n; i++)
        lights->list[i].dark = TRUE; /* the driver's open() has switched it off */
    return lights;
}

void lights_free(struct lights *lights) {
    if (!lights)
        return;
    clock_cancel(lights->device->clock, &lights->retry);
    g_queue_clear_full(&lights->commands, command_free);
    g_free(lights->list);
    g_free(lights);
}

static gboolean covers(const struct command *command, int i) {
    return command->index < 0 || command->index == i;
}

/* Returns whether an "off" was sent after the last "on" of the output and may still be answered in
 * time. */
static gboolean off_is_due(const struct lights *lights, int i) {
    for (const GList *l = lights->commands.head; l; l = l->next) {
        const struct command *command = l->data;
        if (!command->on && !command->overdue && covers(command, i) &&
            command->number > lights->list[i].on_number)
            return TRUE;
    }
    return FALSE;
}

static gboolean must_go_off(const struct lights *lights, int i) {
    return lights->list[i].failed && !lights->list[i].wanted;
}

static gboolean any_failed(const struct lights *lights) {
    for (int i = 0; i < lights->n; i++)
        if (lights->list[i].failed)
            return TRUE;
    return FALSE;
}

static void took_off(struct light_output *output, const struct command *command, gboolean failed) {
    const gboolean on_again = output->on_number > command->number;
    if (failed && command->retry && output->dark)
        return; /* another "off" was confirmed meanwhile */
    if (failed) {
        output->dark = output->dark && on_again;
        output->failed |= !on_again;
        return;
    }
    if (!on_again) {
        output->dark = TRUE;
        output->failed = FALSE;
    }
}

/* Takes the end of an "on", which was confirmed or has failed. off_due says that an "off" was
 * sent after it. The answer to that "off" then decides whether the light is safe. */
static void took_on(struct light_output *output, const struct command *command, gboolean failed,
                    gboolean off_due) {
    const gboolean last = output->on_number == command->number;
    if (!failed)
        output->dark = FALSE;
    if (failed && last)
        output->wanted = FALSE;
    if (output->wanted)
        output->failed &= failed || !last;
    else
        output->failed |= !off_due;
}

static void lights_retry(gpointer data);

/* Reports whether the device is safe, and schedules a new attempt for outputs that should be
 * off. */
static void settle(struct lights *lights, const GError *error) {
    gboolean due = FALSE;
    for (int i = 0; i < lights->n; i++)
        due |= must_go_off(lights, i) && !off_is_due(lights, i);
    if (!any_failed(lights)) {
        lights->pause_us = 0;
        device_report_safety(lights->device, NULL);
    } else if (error) {
        device_report_safety(lights->device, error);
    }
    if (due && lights->retry == 0)
        lights->retry =
            clock_call_in(lights->device->clock, lights->pause_us, lights_retry, lights);
}

/* Updates the state of the lights when a command was answered, was refused or is overdue. error
 * is NULL if the device has confirmed the command. */
static void take(struct lights *lights, const struct command *command, const GError *error) {
    if (!error || command->on)
        lights->pause_us = 0; /* an "on" that failed is followed by "off" without a pause */
    else
        lights->pause_us =
            lights->pause_us ? MIN(2 * lights->pause_us, MAX_PAUSE_US) : FIRST_PAUSE_US;
    for (int i = 0; i < lights->n; i++) {
        if (covers(command, i) && command->on)
            took_on(&lights->list[i], command, error != NULL, off_is_due(lights, i));
        else if (covers(command, i))
            took_off(&lights->list[i], command, error != NULL);
    }
    settle(lights, error);
}

/* Removes an older overdue "off" to the same light from the list. An answer that still comes proves
 * the same for both, so only the newer "off" is kept. The older one stays if an "on", or a command
 * that may still be answered in time, was sent between them. */
static void forget_older(struct lights *lights, const struct command *command) {
    GList *l = g_queue_find(&lights->commands, command);
    for (l = l ? l->prev : NULL; l; l = l->prev) {
        struct command *older = l->data;
        if (older->on || !older->overdue)
            return;
        if (older->index == command->index) {
            g_queue_delete_link(&lights->commands, l);
            command_free(older);
            return;
        }
    }
}

static void on_deadline(gpointer data) {
    struct command *command = data;
    struct lights *lights = command->lights;
    struct device *device = lights->device;
    const struct command copy = *command;
    const gint64 now = clock_now_us(device->clock);
    g_autofree char *which = copy.index < 0 ? g_strdup("all lamps ")
                             : lights->many ? g_strdup_printf("lamp %d ", copy.index)
                                            : g_strdup("");
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, device->who, "%sdid not answer to \"%s\" within %d s%s", which,
        copy.on ? "on" : "off", (int)(DEADLINE_US / G_USEC_PER_SEC),
        copy.on || lights->many ? ERROR_ADVICE "check its cable and power"
                                : ERROR_ADVICE "it may still shine: cut its power by hand");
    command->deadline = 0;
    command->overdue = TRUE;
    if (!copy.on)
        forget_older(lights, command);
    take(lights, &copy, error);
    if (!copy.retry)
        lights->answer(device, copy.index, copy.on, now, error);
}

/* Sends a command. Returns FALSE if the device has refused it; then nobody is to be answered. */
static gboolean lights_command(struct lights *lights, int index, gboolean on, gboolean retry,
                               GError **error) {
    struct command *command = g_new0(struct command, 1);
    *command = (struct command){lights, ++lights->n_commands, index, on, retry};
    for (int i = 0; i < lights->n; i++) {
        struct light_output *output = &lights->list[i];
        if (!covers(command, i))
            continue;
        output->wanted = on;
        if (on)
            output->dark = FALSE;
        *(on ? &output->on_number : &output->off_number) = command->number;
    }
    g_queue_push_tail(&lights->commands, command);
    GError *failed = NULL;
    if (lights->send(lights->device, index, on, &failed)) {
        command->deadline = clock_call_in(lights->device->clock, DEADLINE_US, on_deadline, command);
        return TRUE;
    }
    if (!failed)
        failed = device_error_new(DEVICE_ERROR_PROTOCOL, lights->device->who,
                                  "it refused the command without a reason" ERROR_ADVICE
                                  "check its power and its cable");
    g_queue_remove(&lights->commands, command);
    take(lights, command, failed);
    command_free(command);
    g_propagate_error(error, failed);
    return FALSE;
}

/* Sends "off" again to lights that should be off, one command at a time. If the device has many
 * lights and none of them should be on, the command is for all lights. Otherwise it is for one
 * light. */
static void lights_retry(gpointer data) {
    struct lights *lights = data;
    int first = -1, n_wanted = 0;
    lights->retry = 0;
    for (int k = 0; k < lights->n; k++) {
        const int i = (lights->turn + k) % lights->n;
        n_wanted += lights->list[i].wanted;
        if (first < 0 && must_go_off(lights, i) && !off_is_due(lights, i))
            first = i;
    }
    for (const GList *l = lights->commands.head; l; l = l->next) {
        const struct command *command = l->data;
        if (command->retry && !command->overdue)
            return; /* when that command ends, settle() schedules the next attempt */
    }
    if (first < 0)
        return;
    lights->turn = (first + 1) % lights->n;
    lights_command(lights, lights->many && n_wanted == 0 ? -1 : first, FALSE, TRUE, NULL);
}

gboolean lights_set(struct lights *lights, int index, gboolean on, GError **error) {
    return lights_command(lights, index, on, FALSE, error);
}

/* Returns the command to which an answer belongs, or NULL if none fits. The commands to one light
 * are answered in order, but an overdue command may never be answered. If several commands request
 * the same state with no other command between them, an answer proves the same for each. It is then
 * taken as the answer to the first command that is not overdue, or else to the first overdue
 * one. */
static struct command *find_command(const struct lights *lights, int index, gboolean on) {
    struct command *overdue = NULL;
    for (const GList *l = lights->commands.head; l; l = l->next) {
        struct command *command = l->data;
        const gboolean overlaps = command->index == index || command->index < 0 || index < 0;
        const gboolean fits = command->index == index && command->on == on;
        if (fits && !command->overdue)
            return command;
        if (fits)
            overdue = overdue ? overdue : command;
        else if (overlaps && (overdue || !command->overdue))
            return overdue;
    }
    return overdue;
}

/* Removes a command that was answered from the list. Also removes the commands before it that will
 * never be answered. */
static void take_command(struct lights *lights, struct command *command) {
    for (GList *l = lights->commands.head, *next; l->data != command; l = next) {
        struct command *older = l->data;
        next = l->next;
        if (!older->overdue || (command->index >= 0 && older->index != command->index))
            continue;
        g_queue_delete_link(&lights->commands, l);
        command_free(older);
    }
    g_queue_remove(&lights->commands, command);
}

/* Takes a report of light that nobody has requested. */
static void believe(struct lights *lights, int index) {
    const struct command unknown = {.index = index, .on = TRUE};
    g_autoptr(GError) error = device_error_new(DEVICE_ERROR_PROTOCOL, lights->device->who,
                                               "it reports light without a command" ERROR_ADVICE
                                               "check what else switches it");
    take(lights, &unknown, NULL);
    settle(lights, error);
}

void lights_report(struct lights *lights, int index, gboolean on, const GError *error) {
    struct command *command = find_command(lights, index, on);
    const gint64 now = clock_now_us(lights->device->clock);
    if (!command) {
        if (!error && on && index >= 0 && index < lights->n)
            believe(lights, index);
        return;
    }
    take_command(lights, command);
    const gboolean heard = !command->retry && !command->overdue;
    if (!command->overdue || !error)
        take(lights, command, error);
    command_free(command);
    if (heard)
        lights->answer(lights->device, index, on, now, error);
}

void lights_lost(struct lights *lights, const GError *error) {
    g_autoptr(GError) unsent = NULL;
    for (int i = 0; i < lights->n; i++) {
        lights->list[i].wanted = lights->list[i].dark = FALSE;
        lights->list[i].failed = TRUE;
    }
    device_report_safety(lights->device, error);
    lights_set(lights, lights->many ? -1 : 0, FALSE, &unsent);
}

enum light lights_light(const struct lights *lights, int index) {
    return lights->list[index].dark     ? LIGHT_OFF
           : must_go_off(lights, index) ? LIGHT_UNSAFE
                                        : LIGHT_ON;
}

enum device_safety lights_safety(const struct lights *lights) {
    gboolean dark = TRUE, due = FALSE;
    for (int i = 0; i < lights->n; i++)
        dark &= lights->list[i].dark;
    for (const GList *l = lights->commands.head; l; l = l->next) {
        const struct command *command = l->data;
        due |= !command->overdue && !command->retry;
    }
    return any_failed(lights) ? DEVICE_UNSAFE
           : due              ? DEVICE_TOLD
           : dark             ? DEVICE_SAFE
                              : DEVICE_UNSAFE;
}
