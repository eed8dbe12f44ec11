#include "safe_state.h"

#include "devices_private.h"

#include "drivers/lock.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define PATIENCE_US (5 * G_USEC_PER_SEC)  /* time for which failed devices are tried again */
#define PAUSE_US    (200 * 1000)          /* between two tries */
#define LIMIT_US    (30 * G_USEC_PER_SEC) /* limit of the process of a line */
#define MAX_TEXT    1500                  /* with the rest of a struct result less than PIPE_BUF */

struct job { /* a device to be made safe */
    const struct config_section *section;
    const struct driver_info *info; /* NULL: its driver is not known */
    char *name;                     /* "laser top" */
    char *line;                     /* one process handles all devices of a line, in turn */
};

struct SafeState {
    Config *config;
    GPtrArray *jobs; /* of struct job, lights first */
};

struct result { /* written by one process, read by the other */
    int job;
    gboolean safe;
    char text[MAX_TEXT];
};

struct repaired { /* a section reduced to its valid keys */
    GString *text;
    GString *notes;  /* what was left out */
    GString *doubts; /* parts left out that may identify the device */
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

/* Keys of the line: with a wrong one the device does not answer, and counts as not off. */
static const char *const line_keys[] = {"baud",    "parity",  "stop_bits", "timeout_ms",
                                        "late_ms", "retries", NULL};

static void safe_state_job_free(gpointer data) {
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

/* Sections with a driver of lasers, lamps or axes, whatever their class name is; and sections
 * without a known driver whose class name is one of these or unknown. */
static gboolean is_job(const struct config_section *section, const struct driver_info *info) {
    static const char *const others[] = {"rig", "lamp", "camera", "interlock", "mark", NULL};

    if (info)
        return g_strv_contains(device_classes, info->class_name);
    if (config_value(section, "mount_of", NULL))
        return FALSE;
    return g_strv_contains(device_classes, section->class_name) ||
           (!g_strv_contains(others, section->class_name) && *config_keys(section));
}

static void add_job(SafeState *state, const struct config_section *section) {
    const struct driver_info *info = drivers_by_name(section);

    if (!is_job(section, info))
        return;
    const char *bus = config_value(section, "bus", NULL);
    const char *serial = config_value(section, "serial", NULL);
    const char *path = config_value(section, "path", NULL);
    struct job *job = g_new0(struct job, 1);
    job->section = section;
    job->info = info;
    job->name = g_strconcat(class_of(job), section->name ? " " : "", section->name, NULL);
    job->line =
        bus ? g_strdup(bus) : g_strdup_printf("usb %s %s", serial ? serial : "", path ? path : "");
    g_ptr_array_add(state->jobs, job);
}

/* Lasers, then lamps, then axes, otherwise as in the file. */
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
    state->jobs = g_ptr_array_new_with_free_func(safe_state_job_free);
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

/* Whether the section has all keys that identify the device: then an unknown key cannot be a
 * misspelling of one of them. */
static gboolean says_which(const struct job *job) {
    for (const struct option *option = job->info->options; option && option->name; option++)
        if (!g_strv_contains(harmless, option->name) && !g_strv_contains(line_keys, option->name) &&
            !config_value(job->section, option->name, NULL))
            return FALSE;
    return TRUE;
}

/* Adds the problems of lines of this section that could not be read. A problem in the line of the
 * heading is one of the heading itself; without a heading the first keys may be missing too. */
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

/* Puts every key on its line of the file, so that errors of drivers name that line. */
static void add_line(struct repaired *repaired, int *at, int line, const char *key,
                     const char *value) {
    const int target =
        repaired->text->len ? MAX(line, *at + 1) : line; /* never two keys on one line */

    for (; *at < target; (*at)++)
        g_string_append_c(repaired->text, '\n');
    g_string_append_printf(repaired->text, "%s%s%s", key, value ? " = " : "", value ? value : "");
}

/* FALSE for keys of speeds and watchdogs: a device is only stopped or switched off, and a wrong
 * speed must not be written. */
static gboolean safe_state_is_wanted(const char *key, gboolean quick) {
    static const char *const unwanted[] = {"speed_register",    "accel_register", "watchdog",
                                           "watchdog_register", "pulse_coil",     NULL};
    return !g_strv_contains(unwanted, key) && !(quick && strcmp(key, "retries") == 0);
}

static void safe_state_repair_keys(const struct job *job, gboolean quick, const char *const *also,
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
            if (!g_strv_contains(also, *key) && safe_state_is_wanted(*key, quick))
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

/* Adds keys without a default that do not matter here, but that the driver requires. */
static void safe_state_add_missing(const struct job *job, const char *const *also, gboolean quick,
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

/* quick: try once only, while other devices wait for their turn. */
static void safe_state_repair(const struct job *job, gboolean quick, struct repaired *ret) {
    g_autofree const char **layout = layout_keys(class_of(job));
    g_autoptr(GPtrArray) also = g_ptr_array_new();

    *ret = (struct repaired){g_string_new(NULL), g_string_new(NULL), g_string_new(NULL)};
    for (const char **key = layout; *key; key++)
        g_ptr_array_add(also, (gpointer)*key);
    g_ptr_array_add(also, NULL);
    note_problems(job, ret);
    safe_state_repair_keys(job, quick, (const char *const *)also->pdata, ret);
    safe_state_add_missing(job, (const char *const *)also->pdata, quick, ret);
    g_string_append_printf(ret->text, "\n");
}

/* Opens the device as a rig of one device. */
static gboolean safe_state_open_device(struct devices *devices, const struct job *job,
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
    const gboolean safe =
        safe_state_open_device(devices, job, config_sections(config, &n), error) &&
        devices_secure(devices, error);
    devices_close(devices);
    return safe;
}

G_GNUC_PRINTF(4, 5)
static void set_result(struct result *result, gboolean safe, const struct job *job,
                       const char *format, ...) {
    va_list args;

    va_start(args, format);
    g_autofree char *words = g_strdup_vprintf(format, args);
    va_end(args);
    result->safe = safe;
    g_snprintf(result->text, sizeof result->text, "%s: %s%s", job->name,
               safe ? "" : "NOT safe: ", words);
}

/* Who has a board that was switched off all the same. */
static void note_other(pid_t other, gboolean axis, GString *notes) {
    if (other == 0)
        return;
    g_autofree char *process = lock_process(other);
    g_autofree char *note =
        g_strdup_printf("%s has it open, and may %s again: end it, or use “mesorig safe”", process,
                        axis ? "move it" : "switch it on");
    add_words(notes, note);
}

/* FALSE: to be tried again. */
static gboolean try_job(const struct job *job, gboolean quick, struct result *result) {
    g_autoptr(GError) error = NULL;
    struct repaired repaired;

    if (!job->info) {
        if (g_strv_contains(device_classes, job->section->class_name))
            drivers_find(job->section, &error);
        else
            config_set_error(&error, CONFIG_ERROR_UNKNOWN, job->section, NULL,
                             "there is no such section, and its driver is not known");
        set_result(result, FALSE, job, "%s", error->message);
        return TRUE;
    }
    safe_state_repair(job, quick, &repaired);
    const char *done = is_axis(job) ? "stands" : "off";
    lock_steal_found();
    const gboolean safe = secure_section(job, repaired.text->str, &error);
    const pid_t other = lock_steal_found();
    note_other(safe ? other : 0, is_axis(job), repaired.notes);
    const char *notes = repaired.notes->str;
    if (!safe)
        set_result(result, FALSE, job, "%s%s%s%s%s", error->message, *notes ? "; " : "", notes,
                   repaired.doubts->len ? "; " : "", repaired.doubts->str);
    else if (repaired.doubts->len)
        set_result(result, FALSE, job,
                   "what its section names is %s, read back, but may not be it: %s%s%s", done,
                   repaired.doubts->str, *notes ? "; " : "", notes);
    else
        set_result(result, TRUE, job, "%s, read back%s%s", done, *notes ? "; " : "", notes);
    g_string_free(repaired.text, TRUE);
    g_string_free(repaired.notes, TRUE);
    g_string_free(repaired.doubts, TRUE);
    return safe || error->domain != DEVICE_ERROR;
}

/* One line's devices, in a process of its own. */
static void work_line(const SafeState *state, const char *line, int fd) {
    const gint64 until = g_get_monotonic_time() + PATIENCE_US;
    g_autofree gboolean *done = g_new0(gboolean, state->jobs->len);
    gboolean again = TRUE, late = FALSE;

    for (int pass = 0; again; pass++) {
        again = FALSE;
        if (pass > 0)
            g_usleep(PAUSE_US);
        late = g_get_monotonic_time() > until;
        for (guint i = 0; i < state->jobs->len; i++) {
            const struct job *job = state->jobs->pdata[i];
            struct result result = {.job = (int)i};
            if (done[i] || strcmp(job->line, line) != 0)
                continue;
            done[i] = try_job(job, pass == 0, &result) || late;
            if (done[i] && write(fd, &result, sizeof result) != sizeof result)
                g_printerr("mesorigd: %s\n", result.text);
            again |= !done[i];
        }
    }
}

/* One process a line; if none can be had, it is done here. */
static GArray *start_lines(const SafeState *state, const int *fds) {
    GArray *pids = g_array_new(FALSE, FALSE, sizeof(pid_t));
    g_autoptr(GHashTable) lines = g_hash_table_new(g_str_hash, g_str_equal);

    for (guint i = 0; i < state->jobs->len; i++) {
        const struct job *job = state->jobs->pdata[i];
        if (!g_hash_table_add(lines, job->line))
            continue; /* the line has its process */
        const pid_t pid = fork();
        if (pid == 0) {
            close(fds[0]);
            work_line(state, job->line, fds[1]);
            _exit(0);
        }
        if (pid > 0)
            g_array_append_val(pids, pid);
        else
            work_line(state, job->line, fds[1]);
    }
    return pids;
}

/* Collects the results of the lines' processes, until the last has ended. */
static void collect_results(int fd, gboolean *reported, gboolean *ret_safe) {
    const gint64 until = g_get_monotonic_time() + LIMIT_US;
    struct result result;
    ssize_t n = 1;

    while (n > 0) {
        struct pollfd at = {.fd = fd, .events = POLLIN};
        const gint64 left_us = until - g_get_monotonic_time();
        const int ready = left_us > 0 ? poll(&at, 1, (int)(left_us / 1000) + 1) : 0;
        if (ready < 0 && errno == EINTR)
            continue;
        if (ready <= 0)
            return;
        n = read(fd, &result, sizeof result);
        if (n != sizeof result)
            continue;
        result.text[MAX_TEXT - 1] = '\0';
        reported[result.job] = TRUE;
        *ret_safe &= result.safe;
        g_print("%s\n", result.text);
    }
}

static gboolean make_jobs(const SafeState *state) {
    g_autofree gboolean *reported = g_new0(gboolean, state->jobs->len);
    gboolean safe = TRUE;
    int fds[2];

    if (pipe2(fds, O_CLOEXEC) < 0) {
        g_print("NOT safe: cannot make a pipe: %s\n", g_strerror(errno));
        return FALSE;
    }
    g_autoptr(GArray) pids = start_lines(state, fds);
    close(fds[1]);
    collect_results(fds[0], reported, &safe);
    for (guint i = 0; i < pids->len; i++) {
        kill(g_array_index(pids, pid_t, i), SIGKILL);
        waitpid(g_array_index(pids, pid_t, i), NULL, 0);
    }
    close(fds[0]);
    for (guint i = 0; i < state->jobs->len; i++) {
        const struct job *job = state->jobs->pdata[i];
        if (reported[i])
            continue;
        safe = FALSE;
        g_print("%s: NOT safe: its driver has crashed, or has not ended within %d s\n", job->name,
                (int)(LIMIT_US / G_USEC_PER_SEC));
    }
    return safe;
}

gboolean safe_state_make(const SafeState *state) {
    gsize n;
    const struct config_problem *problems = config_problems(state->config, &n);

    /* All lines that could not be read; those in a device's section are with its result, too. */
    for (gsize i = 0; i < n; i++)
        g_printerr("mesorigd: left out: %s\n", problems[i].message);
    if (state->jobs->len == 0) {
        g_printerr("mesorigd: NOT safe: %s names no laser, no lamps and no axis\n",
                   config_path(state->config));
        return FALSE;
    }
    const gboolean safe = make_jobs(state);
    if (safe)
        g_print("lamps and lasers are off, axes stand\n");
    else
        g_printerr("mesorigd: the rig is NOT safe: switch off by hand what is named above\n");
    return safe;
}
