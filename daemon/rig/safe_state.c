#include "safe_state.h"

#include "devices_private.h"

#include "drivers/lock.h"

#include <math.h>
#include <string.h>

struct job { /* a device to be made safe */
    const struct config_section *section;
    const struct driver_info *info; /* NULL if its driver is not known */
    char *name;                     /* "laser top" */
    /* name of the line; devices on the same line cannot be reached at the same time */
    char *line;
};

struct SafeState {
    Config *config;
    GPtrArray *jobs; /* of struct job, lights first */
};

struct repaired { /* a section reduced to its valid keys */
    GString *text;
    GString *notes; /* messages about keys and lines that were left out and do not matter */
    /* messages about keys and lines that were left out and may identify the device */
    GString *doubts;
};

/* Keys that neither identify the device nor determine how it is switched or stopped. */
static const char *const harmless[] = {
    /* motion and waiting */
    "warm_up_s", "warm_up_ms", "wraps", "min_deg", "max_deg", "speed_deg_s", "accel_deg_s2",
    "backlash_deg", "settle_ms", "home_deg", "steps_per_deg", "tolerance_deg", "target_register",
    "target_bits", "speed_register", "speed_bits", "speed_scale", "accel_register", "accel_bits",
    "accel_scale", "start", "home", "homing", "clear", "poll_ms", "start_ms", "stall_ms", "lost_ms",
    "homed_bit", "fault_bit", "limit_bit", "verify",
    /* watchdogs */
    "watchdog", "watchdog_ms", "watchdog_register", "watchdog_after_s", "watchdog_scale",
    "pulse_coil", NULL};

/* Keys of the line. If one of them is wrong, the device does not answer, and so counts as not
 * safe. */
static const char *const line_keys[] = {"baud",    "parity",  "stop_bits", "timeout_ms",
                                        "late_ms", "retries", "start_s",   NULL};

static void job_free(gpointer data) {
    struct job *job = data;
    g_free(job->name);
    g_free(job->line);
    g_free(job);
}

static const char *const device_classes[] = {"laser", "lamps", "axis", NULL};

static const char *class_of(const struct job *job) {
    return job->info ? job->info->class_name : job->section->class_name;
}

static gboolean is_axis(const struct job *job) {
    return strcmp(class_of(job), "axis") == 0;
}

/* Returns whether a section describes a device that has to be made safe. If the driver is known, it
 * must be a driver of lasers, lamps or axes. If the driver is not known, the class name of the
 * section must be laser, lamps or axis. A class name that this program does not know also counts if
 * the section has keys. A further mount position of a laser is not a device. */
static gboolean is_job(const struct config_section *section, const struct driver_info *info) {
    static const char *const others[] = {"rig", "lamp", "camera", "interlock", "mark", NULL};

    if (info)
        return g_strv_contains(device_classes, info->class_name);
    if (config_value(section, "mount_of", NULL))
        return FALSE;
    return g_strv_contains(device_classes, section->class_name) ||
           (!g_strv_contains(others, section->class_name) && *config_keys(section));
}

/* Returns the name of the line; g_free(). All simulated devices share one line. Devices without a
 * key that names the line share the line of their driver. */
static char *line_of(const struct config_section *section, const struct driver_info *info) {
    static const char *const keys[] = {"bus", "port", "address", NULL};
    const char *serial = config_value(section, "serial", NULL);
    const char *path = config_value(section, "path", NULL);
    const char *program = config_value(section, "program", NULL);

    if (info && g_str_has_prefix(info->name, "sim-"))
        return g_strdup("the simulated rig");
    for (const char *const *key = keys; *key; key++) {
        const char *value = config_value(section, *key, NULL);
        if (value && *value)
            return g_strdup(value);
    }
    if (program)
        return g_strdup_printf("program %s of [%s]", program, section->group);
    return g_strdup_printf("%s %s %s", info ? info->name : "usb", serial ? serial : "",
                           path ? path : "");
}

static void add_job(SafeState *state, const struct config_section *section) {
    const struct driver_info *info = drivers_by_name(section);

    if (!is_job(section, info))
        return;
    struct job *job = g_new0(struct job, 1);
    job->section = section;
    job->info = info;
    job->name = g_strconcat(class_of(job), section->name ? " " : "", section->name, NULL);
    job->line = line_of(section, info);
    g_ptr_array_add(state->jobs, job);
}

/* Orders lasers before lamps and lamps before axes, and otherwise as in the file. */
static int compare_jobs(gconstpointer a, gconstpointer b) {
    const struct job *const *jobs[] = {a, b};
    int ranks[2];

    for (int i = 0; i < 2; i++) {
        const char *name = class_of(*jobs[i]);
        ranks[i] = strcmp(name, "axis") == 0 ? 2 : strcmp(name, "lamps") == 0;
    }
    return ranks[0] != ranks[1] ? ranks[0] - ranks[1]
                                : (*jobs[0])->section->line - (*jobs[1])->section->line;
}

SafeState *safe_state_read(const char *rig_path, GError **error) {
    Config *config = config_load_lenient(rig_path, error);
    gsize n;

    if (!config)
        return NULL;
    SafeState *state = g_new0(SafeState, 1);
    state->config = config;
    state->jobs = g_ptr_array_new_with_free_func(job_free);
    const struct config_section *sections = config_sections(config, &n);
    for (gsize i = 0; i < n; i++)
        add_job(state, &sections[i]);
    g_ptr_array_sort(state->jobs, compare_jobs);
    return state;
}

void safe_state_free(SafeState *state) {
    if (!state)
        return;
    g_ptr_array_unref(state->jobs);
    config_free(state->config);
    g_free(state);
}

static void add_words(GString *to, const char *words) {
    g_string_append_printf(to, "%s%s", to->len ? "; " : "", words);
}

/* Returns whether the section has all keys that identify the device or determine how it is
 * switched. An unknown key then cannot be a misspelling of one of them. */
static gboolean says_which(const struct job *job) {
    for (const struct option *option = job->info->options; option && option->name; option++)
        if (!g_strv_contains(harmless, option->name) && !g_strv_contains(line_keys, option->name) &&
            !config_value(job->section, option->name, NULL))
            return FALSE;
    return TRUE;
}

/* Adds the problems of lines of this section that could not be read, as notes or as doubts. A
 * problem in the line of the heading concerns only the heading. In a section without a heading
 * (CONFIG_NO_HEADING), keys that identify the device may be missing, so every problem is a
 * doubt. */
static void note_problems(const struct job *job, struct repaired *repaired) {
    gsize n_problems, n;
    const struct config_problem *problems = config_problems(job->section->config, &n_problems);
    const struct config_section *sections = config_sections(job->section->config, &n);
    const int begin = job->section->line;
    const gboolean last = job->section == &sections[n - 1];
    const int end = last ? G_MAXINT : (job->section + 1)->line;

    for (gsize i = 0; i < n_problems; i++) {
        if (problems[i].line < begin || problems[i].line >= end)
            continue;
        const gboolean headless = strcmp(job->section->class_name, CONFIG_NO_HEADING) == 0;
        const gboolean harms = headless || (problems[i].line != begin && !says_which(job));
        add_words(harms ? repaired->doubts : repaired->notes, problems[i].message);
    }
}

/* Adds a heading or a key, in the line that it has in the rig file, so that errors of drivers name
 * the right line. *at is the number of the present line of the text. */
static void add_line(struct repaired *repaired, int *at, int line, const char *key,
                     const char *value) {
    const int target =
        repaired->text->len ? MAX(line, *at + 1) : line; /* never two keys on one line */

    for (; *at < target; (*at)++)
        g_string_append_c(repaired->text, '\n');
    g_string_append_printf(repaired->text, "%s%s%s", key, value ? " = " : "", value ? value : "");
}

/* Returns FALSE for keys that would write speeds or watchdogs to the device, because the device is
 * only stopped or switched off, and a wrong speed must not be written. Also returns FALSE for the
 * key retries if quick is TRUE. */
static gboolean is_wanted(const char *key, gboolean quick) {
    static const char *const unwanted[] = {"speed_register",    "accel_register", "watchdog",
                                           "watchdog_register", "pulse_coil",     NULL};
    return !g_strv_contains(unwanted, key) && !(quick && strcmp(key, "retries") == 0);
}

static void repair_keys(const struct job *job, gboolean quick, const char *const *also,
                        struct repaired *repaired) {
    int at = 1;
    g_autofree char *heading = g_strdup_printf("[%s]", job->section->group);

    add_line(repaired, &at, job->section->line, heading, NULL);
    for (const char *const *key = config_keys(job->section); *key; key++) {
        g_autoptr(GError) error = NULL;
        int line = 0;
        const char *value = config_value(job->section, *key, &line);
        if (strcmp(*key, "driver") == 0 ||
            options_check_key(job->info->options, job->section, also, *key, &error)) {
            if (!g_strv_contains(also, *key) && is_wanted(*key, quick))
                add_line(repaired, &at, line, *key, value);
            continue;
        }
        const gboolean unknown = g_error_matches(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN);
        const gboolean harms =
            unknown ? !says_which(job)
                    : !g_strv_contains(harmless, *key) && !g_strv_contains(line_keys, *key);
        add_words(harms ? repaired->doubts : repaired->notes, error->message);
    }
}

/* Adds valid values for keys that the driver requires and that do not matter here (harmless), where
 * they are missing or wrong. If quick is TRUE, also adds retries = 0. */
static void add_missing(const struct job *job, const char *const *also, gboolean quick,
                        struct repaired *repaired) {
    for (const struct option *option = job->info->options; option && option->name; option++) {
        if (quick && strcmp(option->name, "retries") == 0)
            g_string_append(repaired->text, "\nretries = 0");
        const gboolean list = option->type == OPTION_STRINGS;
        const char *value = config_value(job->section, option->name, NULL);
        if (option->fallback || !g_strv_contains(harmless, option->name) ||
            (value &&
             options_check_key(job->info->options, job->section, also, option->name, NULL)))
            continue;
        const double one = option->min == option->max ? 1 : CLAMP(1, option->min, option->max);
        g_string_append_printf(repaired->text, "\n%s = %s%d", option->name, list ? "0=" : "",
                               (int)ceil(one));
        g_autofree char *note = g_strconcat(option->name, " is missing", NULL);
        if (!value)
            add_words(repaired->notes, note);
    }
}

/* Makes a valid section from the section of the device. If quick is TRUE, the driver does not
 * repeat requests, because other devices on the line wait. */
static void repair(const struct job *job, gboolean quick, struct repaired *ret) {
    g_autofree const char **layout = layout_keys(class_of(job));
    g_autoptr(GPtrArray) also = g_ptr_array_new();

    *ret = (struct repaired){g_string_new(NULL), g_string_new(NULL), g_string_new(NULL)};
    for (const char **key = layout; *key; key++)
        g_ptr_array_add(also, (gpointer)*key);
    g_ptr_array_add(also, NULL);
    note_problems(job, ret);
    repair_keys(job, quick, (const char *const *)also->pdata, ret);
    add_missing(job, (const char *const *)also->pdata, quick, ret);
    g_string_append_printf(ret->text, "\n");
}

/* Opens a device and puts it into devices, which must be empty. */
static gboolean open_device(struct devices *devices, const struct job *job,
                            const struct config_section *section, GError **error) {
    gconstpointer driver = job->info;

    devices->clock = clock_new_real();
    if (is_axis(job)) {
        devices->turntable = axis_open(driver, section, NULL, devices->clock, error);
        return devices->turntable != NULL;
    }
    if (strcmp(class_of(job), "lamps") == 0) {
        devices->banks[0] = lamps_open(driver, section, NULL, devices->clock, error);
        devices->n_banks = devices->banks[0] != NULL;
        return devices->n_banks > 0;
    }
    devices->lasers[0] = laser_open(driver, section, NULL, devices->clock, error);
    devices->geometry.n_lasers = devices->lasers[0] != NULL;
    return devices->geometry.n_lasers > 0;
}

static gboolean secure_section(const struct job *job, const char *text, GError **error) {
    g_autoptr(Config) config = config_parse(text, config_path(job->section->config), error);
    gsize n;

    if (!config)
        return FALSE;
    struct devices *devices = g_new0(struct devices, 1);
    const gboolean safe = open_device(devices, job, config_sections(config, &n), error) &&
                          devices_secure(devices, error);
    devices_close(devices);
    return safe;
}

G_GNUC_PRINTF(3, 4)
static void set_text(char *ret_text, const struct job *job, const char *format, ...) {
    va_list args;

    va_start(args, format);
    g_autofree char *words = g_strdup_vprintf(format, args);
    va_end(args);
    g_snprintf(ret_text, SAFE_STATE_TEXT, "%s: %s", job->name, words);
}

/* Returns whether a guardian can leave a device to the process `other`, which has the device open.
 * This process must be another daemon. Such a daemon has switched the device off when it opened the
 * device, and has its own guardian. */
static gboolean is_left(pid_t other) {
    return lock_get_role() == LOCK_GUARDIAN && lock_is_daemon(other);
}

/* Adds a note about another process that has the device open, although this process has made the
 * device safe. other is 0 if there is no such process. */
static void note_other(pid_t other, gboolean axis, GString *notes) {
    if (other == 0)
        return;
    g_autofree char *process = lock_process(other);
    g_autofree char *note = g_strdup_printf(
        "%s has the device open, and may %s again: end that process, or use “mesorig safe”",
        process, axis ? "move it" : "switch it on");
    add_words(notes, note);
}

enum safe_try safe_state_try(const SafeState *state, int index, gboolean quick, char *ret_text) {
    const struct job *job = state->jobs->pdata[index];
    g_autoptr(GError) error = NULL;
    struct repaired repaired;
    enum safe_try result;

    if (!job->info) {
        if (g_strv_contains(device_classes, job->section->class_name))
            drivers_find(job->section, &error);
        else
            config_set_error(&error, CONFIG_ERROR_UNKNOWN, job->section, NULL,
                             "there is no such class of sections, so the driver is not known");
        set_text(ret_text, job, "NOT safe: %s", error->message);
        return SAFE_TRY_NEVER;
    }
    repair(job, quick, &repaired);
    lock_steal_found();
    const gboolean safe = secure_section(job, repaired.text->str, &error);
    const pid_t other = lock_steal_found();
    note_other(safe ? other : 0, is_axis(job), repaired.notes);
    const char *notes = repaired.notes->str;
    const char *confirmed = job->info->confirmed ? job->info->confirmed : "read back";
    if (!safe)
        set_text(ret_text, job, "NOT safe: %s%s%s%s%s", error->message, *notes ? "; " : "", notes,
                 repaired.doubts->len ? "; " : "", repaired.doubts->str);
    else if (repaired.doubts->len)
        set_text(ret_text, job,
                 "NOT safe: the device that its section names %s, %s, but it may be another "
                 "device: %s%s%s",
                 is_axis(job) ? "stands" : "is off", confirmed, repaired.doubts->str,
                 *notes ? "; " : "", notes);
    else
        set_text(ret_text, job, "%s, %s%s%s", is_axis(job) ? "stands" : "off", confirmed,
                 *notes ? "; " : "", notes);
    if (safe)
        result = repaired.doubts->len ? SAFE_TRY_NEVER : SAFE_TRY_SAFE;
    else if (g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_BUSY) && other != 0 &&
             lock_is_daemon(other))
        result = SAFE_TRY_OTHER;
    else
        result = error->domain == DEVICE_ERROR && !is_left(other) ? SAFE_TRY_AGAIN : SAFE_TRY_NEVER;
    g_string_free(repaired.text, TRUE);
    g_string_free(repaired.notes, TRUE);
    g_string_free(repaired.doubts, TRUE);
    return result;
}

int safe_state_n(const SafeState *state) {
    return (int)state->jobs->len;
}

const char *safe_state_name(const SafeState *state, int index) {
    return ((const struct job *)state->jobs->pdata[index])->name;
}

const char *safe_state_line(const SafeState *state, int index) {
    return ((const struct job *)state->jobs->pdata[index])->line;
}

const Config *safe_state_config(const SafeState *state) {
    return state->config;
}

gboolean safe_state_is_simulated(const SafeState *state) {
    for (guint i = 0; i < state->jobs->len; i++) {
        const struct job *job = state->jobs->pdata[i];
        if (job->info && !g_str_has_prefix(job->info->name, "sim-"))
            return FALSE;
    }
    return TRUE;
}
