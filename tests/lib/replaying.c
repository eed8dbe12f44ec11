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
static char *follow(const Recorded *recorded, Replay *replay, const Config *config, Clock *clock) {
    g_autoptr(GHashTable) devices =
        g_hash_table_new_full(g_str_hash, g_str_equal, NULL, opened_free);
    char *why = NULL;
    for (guint i = 0; i < recorded->lines->len; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        if (!line->who)
            continue;
        g_auto(GStrv) words = g_strsplit(line->who, " ", 2);
        const struct config_section *section = config_find(config, words[0], words[1]);
        if (!section || !device_by_text_can(section))
            continue; /* a camera */
        struct opened *opened = g_hash_table_lookup(devices, line->who);
        if (*line->text == '=') {
            /* An interlock reports what it reads, without a call. */
            if (!opened || strcmp(words[0], "interlock") == 0 ||
                g_str_has_prefix(line->text, "= opened"))
                continue;
            opened->n_awaited++;
            UNTIL_WITHIN (20, device_by_text_results(opened->device) >= opened->n_awaited) {
                if ((why = replay_difference(replay)))
                    return why;
                wait_ms(5);
            }
            continue;
        }
        UNTIL_WITHIN (20, replay_is_at(replay, line->number)) {
            if ((why = replay_difference(replay)) ||
                (g_get_monotonic_time() > wait_begun_us + 5 * G_USEC_PER_SEC &&
                 (why = replay_missing(replay))))
                return why;
            wait_ms(5);
        }
        if (strcmp(line->text, "open") == 0) {
            g_autoptr(GError) failed = NULL;
            DeviceByText *device = device_by_text_open(section, clock, &failed);
            if ((why = replay_difference(replay)))
                return device_by_text_close(device), why;
            if (!device)
                continue;
            opened = g_new0(struct opened, 1);
            opened->device = device;
            g_hash_table_insert(devices, line->who, opened);
        } else if (!opened) {
            g_error("%s:%d: the device is not open", recorded->path, line->number);
        } else if (strcmp(line->text, "close") == 0) {
            g_hash_table_remove(devices, line->who);
        } else {
            device_by_text_call(opened->device, line->text);
        }
    }
    /* What was sent last may be on its way. */
    for (int i = 0; i < 200 && !replay_is_at(replay, G_MAXINT); i++)
        g_usleep(10000);
    why = replay_difference(replay);
    return why ? why : replay_missing(replay);
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
