#include "replaying.h"

#include "device_by_text.h"
#include "ok.h"
#include "wait.h"

#include "drivers/recording.h"
#include "virtual/replay/replay.h"

#include <string.h>

struct opened {
    DeviceByText *device;
    int n_awaited; /* results that the recording has so far */
};

static void opened_free(gpointer data) {
    struct opened *opened = data;
    device_by_text_close(opened->device);
    g_free(opened);
}

/* Does the calls of a recording, each as soon as the requests before it have come. Returns the
 * first difference, or NULL; g_free(). */
struct following {
    const Recorded *recorded;
    Replay *replay;
    Clock *clock;
    GHashTable *devices; /* maps a name to a struct opened */
    char *failure;       /* why the device that was opened last cannot be used */
    gint64 at_us;        /* time of the last line of a device */
};

/* Returns how long a line may be waited for. A poll takes as long as in the recording. */
static int limit_s(const struct following *following, const struct recorded_line *line) {
    return 5 + (int)(3 * MAX(line->at_us - following->at_us, 0) / G_USEC_PER_SEC);
}

/* Waits for a result. Returns a difference, or NULL. */
static char *await_result(const struct following *following, const struct recorded_line *line) {
    struct opened *opened = g_hash_table_lookup(following->devices, line->who);
    const gboolean is_opened = g_str_has_prefix(line->text, "= opened");
    if (!opened && is_opened)
        return g_strdup_printf("%s:%d: expected that the device is opened, but: %s",
                               following->recorded->path, line->number, following->failure);
    /* An interlock reports what it reads, without a call. */
    if (!opened || is_opened || g_str_has_prefix(line->who, "interlock "))
        return NULL;
    opened->n_awaited++;
    UNTIL_WITHIN (4 * limit_s(following, line),
                  device_by_text_results(opened->device) >= opened->n_awaited) {
        char *why = replay_difference(following->replay);
        if (why)
            return why;
        wait_ms(5);
    }
    return NULL;
}

/* Waits for the requests before a call. Returns a difference, or NULL. */
static char *await_requests(const struct following *following, const struct recorded_line *line) {
    const gint64 late_us = g_get_monotonic_time() + limit_s(following, line) * G_USEC_PER_SEC;
    while (!replay_is_at(following->replay, line->number)) {
        char *why = replay_difference(following->replay);
        if (!why && g_get_monotonic_time() > late_us)
            why = replay_missing(following->replay);
        if (why)
            return why;
        wait_ms(5);
    }
    return NULL;
}

/* Opens a device. Returns a difference, or NULL. */
static char *open_device(struct following *following, const struct recorded_line *line,
                         const struct config_section *section) {
    g_autoptr(GError) error = NULL;
    DeviceByText *device = device_by_text_open(section, following->clock, &error);
    if (device) {
        struct opened *opened = g_new0(struct opened, 1);
        opened->device = device;
        g_hash_table_insert(following->devices, line->who, opened);
    } else {
        g_free(following->failure);
        following->failure = g_strdup(error->message);
    }
    return replay_difference(following->replay);
}

static char *do_line(struct following *following, const struct recorded_line *line,
                     const struct config_section *section) {
    if (*line->text == '=')
        return await_result(following, line);
    char *why = await_requests(following, line);
    struct opened *opened = g_hash_table_lookup(following->devices, line->who);
    if (why)
        return why;
    if (strcmp(line->text, "open") == 0)
        return open_device(following, line, section);
    if (!opened)
        return g_strdup_printf("%s:%d: the device is not open", following->recorded->path,
                               line->number);
    if (strcmp(line->text, "close") == 0)
        g_hash_table_remove(following->devices, line->who);
    else
        device_by_text_call(opened->device, line->text);
    return NULL;
}

/* Does the calls of a recording. Returns the first difference, or NULL; g_free(). */
static char *follow(const Recorded *recorded, Replay *replay, const Config *config, Clock *clock) {
    struct following following = {
        recorded, replay, clock, g_hash_table_new_full(g_str_hash, g_str_equal, NULL, opened_free)};
    char *why = NULL;
    for (guint i = 0; i < recorded->lines->len && !why; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        if (!line->who)
            continue;
        g_auto(GStrv) words = g_strsplit(line->who, " ", 2);
        const struct config_section *section = config_find(config, words[0], words[1]);
        if (section && device_by_text_can(section)) /* not a camera */
            why = do_line(&following, line, section);
        following.at_us = line->at_us;
    }
    /* What was sent last may be on its way. */
    for (int i = 0; i < 200 && !why && !replay_is_at(replay, G_MAXINT); i++)
        g_usleep(10000);
    if (!why && !(why = replay_difference(replay)))
        why = replay_missing(replay);
    g_hash_table_unref(following.devices);
    g_free(following.failure);
    return why;
}

/* Appends the lines of a device, without times and without the words of errors. */
static void add_lines(GString *to, const Recorded *recorded, const char *who) {
    for (guint i = 0; i < recorded->lines->len; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        if (g_strcmp0(line->who, who) != 0)
            continue;
        const char *colon = *line->text == '=' ? strchr(line->text, ':') : NULL;
        g_string_append_printf(to, "[%s] %.*s\n", who,
                               colon ? (int)(colon - line->text) : (int)strlen(line->text),
                               line->text);
    }
}

/* Returns the lines of the devices that were replayed, one device after another. */
static char *of_devices(const Recorded *recorded, const Config *config) {
    GString *to = g_string_new(NULL);
    gsize n;
    const struct config_section *sections = config_sections(config, &n);
    for (gsize i = 0; i < n; i++)
        if (device_by_text_can(&sections[i]))
            add_lines(to, recorded, sections[i].group);
    return g_string_free(to, FALSE);
}

char *replaying(const Recorded *recorded) {
    g_autoptr(Replay) replay =
        ok(replay_new(recorded, SOURCE_DIR "/tests/recordings/pipe.py", ERR));
    g_autoptr(Config) config = ok(config_parse(replay_sections(replay), "./replay.conf", ERR));
    Clock *clock = clock_new_real();
    recording_begin();
    char *why = follow(recorded, replay, config, clock);
    clock_unref(clock);
    g_autofree char *now = recording_end();
    if (why)
        return why;
    g_autoptr(Recorded) again = ok(recorded_parse(now, "now", ERR));
    g_autofree char *expected = of_devices(recorded, config);
    g_autofree char *seen = of_devices(again, config);
    return strcmp(expected, seen) == 0
               ? NULL
               : g_strdup_printf("%s: expected of the devices:\n%sbut they did:\n%s",
                                 recorded->path, expected, seen);
}

void replaying_well(const char *text, const char *path) {
    g_autoptr(Recorded) recorded = ok(recorded_parse(text, path, ERR));
    g_autofree char *why = replaying(recorded);
    if (why)
        g_error("%s", why);
}
