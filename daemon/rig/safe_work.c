#include "safe_work.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <syslog.h>
#include <unistd.h>

#define PATIENCE_US  (5 * G_USEC_PER_SEC) /* time after which SAFE_UNTIL_TIRED gives up */
#define MIN_PAUSE_US (100 * 1000)         /* pause between the first two attempts */
#define MAX_PAUSE_US (500 * 1000)         /* maximum pause between two attempts */
#define LIMIT_US                                                                                   \
    (30 * G_USEC_PER_SEC) /* time by which the process of a line may exceed its lifetime */
#define LEAVE_US (5 * G_USEC_PER_SEC) /* time of work before let_pipes_go() closes pipes */
#define END_MS   1000                 /* time limit for a killed process to end */
/* Maximum pause before a process is begun after crashes. */
#define MAX_RESTART_US (5 * G_USEC_PER_SEC)
/* Number of attempts to start a process with SAFE_UNTIL_TIRED. They take 3.1 s. */
#define MAX_STARTS 6

/* A line of devices (safe_state_line()). */
struct line {
    const char *name;
    pid_t pid; /* process of the line; 0 if there is none */
    int fd;    /* pipe with the reports of the process; -1 if there is no process */
    /* time when the process began; if there is none, time from which the next one may begin */
    gint64 begin_us;
    int n_begun;   /* number of processes that the line has had */
    int n_crashed; /* number of processes in a row that have crashed or could not be started */
};

enum fate { OPEN, SAFE, GIVEN_UP };

/* A device. */
struct task {
    enum fate fate;
    gboolean hope; /* whether another attempt may make the device safe */
    gboolean told; /* whether the unsafe state of the device was reported */
    char *text;    /* result of the last attempt; NULL if there is none yet */
};

struct SafeWork {
    const SafeState *state;
    enum safe_until until;
    gint64 life_us;  /* lifetime of a process */
    gint64 leave_us; /* time for let_pipes_go(); -1 if it has nothing left to do */
    struct task *tasks;
    GArray *lines; /* of struct line */
    gboolean announced, ended;
};

struct report { /* report of the process of a line; shorter than PIPE_BUF */
    int task;
    enum safe_try result;
    gboolean last; /* whether the process will not try the device again */
    char text[SAFE_STATE_TEXT];
};

G_GNUC_PRINTF(2, 3)
static void tell(const SafeWork *work, const char *format, ...) {
    va_list args;

    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    if (work->until == SAFE_UNTIL_TIRED) {
        g_print("%s\n", text);
        return;
    }
    g_printerr("mesorigd: guardian: %s\n", text);
    if (!g_log_writer_is_journald(fileno(stderr)))
        syslog(LOG_DAEMON | LOG_WARNING, "guardian: %s", text);
}

static gboolean is_of(const SafeWork *work, int task, const struct line *line) {
    return work->tasks[task].fate == OPEN &&
           strcmp(safe_state_line(work->state, task), line->name) == 0;
}

static gboolean is_open(const SafeWork *work, const struct line *line) {
    for (int i = 0; i < safe_state_n(work->state); i++)
        if (is_of(work, i, line))
            return TRUE;
    return FALSE;
}

SafeWork *safe_work_new(const SafeState *state, enum safe_until until, double repeat_s) {
    SafeWork *work = g_new0(SafeWork, 1);
    g_autoptr(GHashTable) known = g_hash_table_new(g_str_hash, g_str_equal);
    const Config *config = safe_state_config(state);
    gsize n_problems;
    const struct config_problem *problems = config_problems(config, &n_problems);

    work->state = state;
    work->until = until;
    work->life_us =
        until == SAFE_UNTIL_TIRED ? PATIENCE_US : (gint64)(repeat_s * (double)G_USEC_PER_SEC);
    work->leave_us = until == SAFE_UNTIL_TIRED ? -1 : g_get_monotonic_time() + LEAVE_US;
    work->tasks = g_new0(struct task, MAX(safe_state_n(state), 1));
    work->lines = g_array_new(FALSE, FALSE, sizeof(struct line));
    for (int i = 0; i < safe_state_n(state); i++) {
        const struct line line = {.name = safe_state_line(state, i), .fd = -1};
        if (g_hash_table_add(known, (gpointer)line.name))
            g_array_append_val(work->lines, line);
    }
    /* Print all lines of the file that could not be read. Those in the section of a device are
     * printed again with the result of the device. */
    for (gsize i = 0; i < n_problems && until != SAFE_UNTIL_SAFE_QUIETLY; i++)
        g_printerr("mesorigd: left out: %s\n", problems[i].message);
    if (safe_state_n(state) == 0)
        g_printerr("mesorigd: NOT safe: %s names no laser, no lamps and no axis\n",
                   config_path(config));
    return work;
}

/* Kills the process of a line and waits up to END_MS for its end. If the kernel does not end the
 * process in this time (because of an unplugged device, for instance), the process is forgotten. */
static void end_process(struct line *line) {
    if (line->pid > 0)
        kill(line->pid, SIGKILL);
    for (int ms = 0; line->pid > 0 && ms < END_MS && waitpid(line->pid, NULL, WNOHANG) == 0;
         ms += 10)
        g_usleep(10 * 1000);
    if (line->fd >= 0)
        close(line->fd);
    line->pid = 0;
    line->fd = -1;
}

void safe_work_free(SafeWork *work) {
    if (!work)
        return;
    for (guint i = 0; i < work->lines->len; i++)
        end_process(&g_array_index(work->lines, struct line, i));
    for (int i = 0; i < safe_state_n(work->state); i++)
        g_free(work->tasks[i].text);
    g_array_unref(work->lines);
    g_free(work->tasks);
    g_free(work);
}

/* LEAVE_US after the work has begun, replaces standard output and standard error by /dev/null if
 * they are pipes. The reader of a pipe may wait until all writers have closed it, as a shell does
 * with $(mesorig …). The processes of lines are writers as well. */
static void let_pipes_go(SafeWork *work) {
    if (work->leave_us < 0 || g_get_monotonic_time() < work->leave_us)
        return;
    work->leave_us = -1;
    for (int fd = STDOUT_FILENO; fd <= STDERR_FILENO; fd++) {
        struct stat file;
        if (fstat(fd, &file) < 0 || !S_ISFIFO(file.st_mode))
            continue;
        const int none = open("/dev/null", O_WRONLY | O_CLOEXEC);
        if (none >= 0 && dup2(none, fd) >= 0)
            close(none);
    }
}

/* The work of the child process of a line: tries the open tasks of the line until all are done or
 * life_us has passed, and writes reports to fd. Each process of a line begins with a different
 * task, so that a task whose driver crashes does not block the others. */
static void work_line(SafeWork *work, const struct line *line, gint64 life_us, int fd) {
    const gint64 until = g_get_monotonic_time() + life_us;
    const int n = safe_state_n(work->state);
    gint64 pause_us = MIN_PAUSE_US;
    gboolean late = FALSE;

    for (int pass = 0; is_open(work, line) && !late; pass++) {
        if (pass > 0) {
            g_usleep((gulong)pause_us);
            pause_us = MIN(2 * pause_us, MAX_PAUSE_US);
        }
        late = g_get_monotonic_time() > until;
        let_pipes_go(work);
        for (int k = 0; k < n; k++) {
            const int i = (k + line->n_begun) % n;
            struct report report = {.task = i, .last = late};
            if (!is_of(work, i, line))
                continue;
            report.result = safe_state_try(work->state, i, pass == 0, report.text);
            const gboolean again =
                report.result == SAFE_TRY_AGAIN || report.result == SAFE_TRY_OTHER;
            if (!again)
                /* only means that this process has finished the task */
                work->tasks[i].fate = SAFE;
            if ((!again || pass == 1 || late) && write(fd, &report, sizeof report) != sizeof report)
                g_printerr("mesorigd: %s\n", report.text);
        }
    }
}

static void become_line(SafeWork *work, const struct line *line, pid_t parent, int fd) {
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != parent)
        _exit(1);
    work_line(work, line, work->life_us, fd);
    _exit(0);
}

static gint64 restart_us(const struct line *line) {
    gint64 us = 0;

    for (int i = 0; i < line->n_crashed && us < MAX_RESTART_US; i++)
        us = us == 0 ? MIN_PAUSE_US : MIN(2 * us, MAX_RESTART_US);
    return us;
}

/* Records for each open task of a line that the process of the line has failed, and reports this
 * once for each task. `why` ends the sentence that names the device. If final is TRUE, gives the
 * tasks up with SAFE_UNTIL_TIRED. */
static void note_failure(SafeWork *work, const struct line *line, const char *why, gboolean final) {
    for (int i = 0; i < safe_state_n(work->state); i++) {
        struct task *task = &work->tasks[i];
        if (!is_of(work, i, line))
            continue;
        if (final && work->until == SAFE_UNTIL_TIRED)
            task->fate = GIVEN_UP;
        if (task->told && line->n_crashed > 1)
            continue;
        task->hope = TRUE;
        g_free(task->text);
        task->text = g_strdup_printf("%s: NOT safe: %s", safe_state_name(work->state, i), why);
        task->told = TRUE;
        tell(work, "%s", task->text);
    }
}

static void begin_process(SafeWork *work, struct line *line) {
    const pid_t parent = getpid();
    int fds[2] = {-1, -1};

    const gboolean piped = pipe2(fds, O_CLOEXEC) == 0;
    const pid_t pid = piped ? fork() : -1;
    const int code = errno;
    if (pid == 0)
        become_line(work, line, parent, fds[1]);
    line->n_begun++;
    line->begin_us = g_get_monotonic_time();
    if (pid > 0) {
        line->pid = pid;
        line->fd = fds[0];
        close(fds[1]);
        return;
    }
    if (piped) {
        close(fds[0]);
        close(fds[1]);
    }
    line->n_crashed++;
    line->begin_us += restart_us(line);
    g_autofree char *why =
        g_strdup_printf("the process that makes it safe cannot be started: %s", g_strerror(code));
    note_failure(work, line, why, line->n_crashed >= MAX_STARTS);
}

static void take_report(SafeWork *work, struct report *report) {
    if (report->task < 0 || report->task >= safe_state_n(work->state))
        return;
    struct task *task = &work->tasks[report->task];
    const gboolean tired = work->until == SAFE_UNTIL_TIRED;
    /* A daemon that has just been killed may still have its devices open for a moment.
     * SAFE_TRY_OTHER is therefore final only in the last report of a process. */
    const gboolean again =
        report->last ? report->result == SAFE_TRY_AGAIN && !tired
                     : report->result == SAFE_TRY_AGAIN || report->result == SAFE_TRY_OTHER;

    report->text[SAFE_STATE_TEXT - 1] = '\0';
    g_free(task->text);
    task->text = g_strdup(report->text);
    task->hope = report->result == SAFE_TRY_AGAIN;
    if (!again)
        task->fate = report->result == SAFE_TRY_SAFE ? SAFE : GIVEN_UP;
    if (again && (tired || (task->told && !report->last)))
        return;
    if (task->fate == SAFE && !task->told && work->until == SAFE_UNTIL_SAFE_QUIETLY)
        return;
    task->told |= task->fate != SAFE;
    tell(work, "%s", task->text);
}

/* Handles the end of the process of a line: its tasks are done, its time is over, or it has
 * crashed. hung is TRUE if the process exceeds its time and has to be killed. */
static void on_process_end(SafeWork *work, struct line *line, gboolean hung) {
    int status = -1;

    const gboolean crashed = hung || waitpid(line->pid, &status, 0) < 0 || status != 0;
    line->pid = hung ? line->pid : 0;
    end_process(line);
    line->n_crashed = crashed ? line->n_crashed + 1 : 0;
    line->begin_us = g_get_monotonic_time() + restart_us(line);
    if (!crashed)
        return;
    g_autofree char *why = hung
                               ? g_strdup_printf("its driver has not ended within %d s",
                                                 (int)((work->life_us + LIMIT_US) / G_USEC_PER_SEC))
                               : g_strdup("its driver has crashed");
    note_failure(work, line, why, TRUE);
}

static void read_line(SafeWork *work, struct line *line) {
    struct report report;
    const ssize_t n = read(line->fd, &report, sizeof report);

    if (n == sizeof report)
        take_report(work, &report);
    else if (n >= 0 || errno != EINTR)
        on_process_end(work, line, FALSE);
}

/* Begins the processes that are due, and kills those that exceed their time. Returns the
 * monotonic time in µs when the next process is due to begin or to be killed, or -1 if there is
 * none. */
static gint64 tend_lines(SafeWork *work) {
    const gint64 now = g_get_monotonic_time();
    gint64 next = -1;

    for (guint i = 0; i < work->lines->len; i++) {
        struct line *line = &g_array_index(work->lines, struct line, i);
        if (line->pid > 0 && now > line->begin_us + work->life_us + LIMIT_US)
            on_process_end(work, line, TRUE);
        if (line->pid == 0 && is_open(work, line) && now >= line->begin_us)
            begin_process(work, line);
        gint64 at = line->begin_us + (line->pid > 0 ? work->life_us + LIMIT_US : 0);
        if (line->pid > 0 || is_open(work, line))
            next = next < 0 ? at : MIN(next, at);
    }
    return next;
}

/* Prints once that the rig is not safe, when every device that is not safe yet has been
 * reported. */
static void announce(SafeWork *work) {
    gboolean open = FALSE, told = TRUE;

    if (work->announced || work->until == SAFE_UNTIL_TIRED)
        return;
    for (int i = 0; i < safe_state_n(work->state); i++) {
        const struct task *task = &work->tasks[i];
        open |= task->fate == OPEN;
        told &= task->fate != OPEN || task->told;
    }
    if (!open || !told)
        return;
    work->announced = TRUE;
    tell(work,
         "the rig is NOT safe: switch off by hand the devices named above; process %d is still "
         "trying",
         (int)getpid());
}

static void finish(SafeWork *work) {
    gboolean told = FALSE;

    work->ended = TRUE;
    for (int i = 0; i < safe_state_n(work->state); i++)
        told |= work->tasks[i].told;
    if (work->until == SAFE_UNTIL_SAFE_QUIETLY && !told)
        return;
    if (safe_work_is_safe(work))
        tell(work, "lamps and lasers are off, axes stand");
    else if (safe_state_n(work->state) == 0)
        return; /* safe_work_new() has printed that the rig file names no device */
    else if (work->until != SAFE_UNTIL_TIRED)
        tell(work, "the rig is NOT safe: switch off by hand the devices named above");
    else
        g_printerr("mesorigd: the rig is NOT safe: switch off by hand the devices named above\n");
}

static gboolean is_at_work(const SafeWork *work) {
    for (guint i = 0; i < work->lines->len; i++) {
        const struct line *line = &g_array_index(work->lines, struct line, i);
        if (line->pid > 0 || is_open(work, line))
            return TRUE;
    }
    return FALSE;
}

/* Returns the earlier one of two times, of which -1 means never. */
static gint64 earlier(gint64 a, gint64 b) {
    return a >= 0 && b >= 0 ? MIN(a, b) : MAX(a, b);
}

static int wait_until(gint64 us) {
    return us < 0 ? -1 : (int)MAX((us - g_get_monotonic_time() + 999) / 1000, 0);
}

gboolean safe_work_run(SafeWork *work, struct pollfd *more, int n, int wait_ms) {
    const gint64 until = wait_ms < 0 ? -1 : g_get_monotonic_time() + wait_ms * (gint64)1000;
    const guint n_lines = work->lines->len;
    g_autofree struct pollfd *fds = g_new0(struct pollfd, n_lines + (guint)n + 1);
    gboolean ready = FALSE;

    do {
        const gint64 next = tend_lines(work);
        let_pipes_go(work);
        if (!is_at_work(work))
            break;
        announce(work);
        for (guint i = 0; i < n_lines; i++)
            fds[i] = (struct pollfd){.fd = g_array_index(work->lines, struct line, i).fd,
                                     .events = POLLIN};
        for (int i = 0; i < n; i++)
            fds[n_lines + (guint)i] = more[i];
        const int at = wait_until(earlier(earlier(next, until), work->leave_us));
        if (poll(fds, n_lines + (guint)n, at) < 0)
            continue;
        for (guint i = 0; i < n_lines; i++)
            if (fds[i].revents)
                read_line(work, &g_array_index(work->lines, struct line, i));
        for (int i = 0; i < n; i++) {
            more[i].revents = fds[n_lines + (guint)i].revents;
            ready |= more[i].revents != 0;
        }
    } while (!ready && (until < 0 || g_get_monotonic_time() < until));
    if (!is_at_work(work) && !work->ended && safe_state_n(work->state) > 0)
        finish(work);
    return is_at_work(work);
}

gboolean safe_work_is_safe(const SafeWork *work) {
    for (int i = 0; i < safe_state_n(work->state); i++)
        if (work->tasks[i].fate != SAFE)
            return FALSE;
    return safe_state_n(work->state) > 0;
}

char *safe_work_unsafe(const SafeWork *work) {
    GString *text = g_string_new(NULL);

    for (int i = 0; i < safe_state_n(work->state); i++) {
        const struct task *task = &work->tasks[i];
        if (task->fate == SAFE)
            continue;
        g_string_append_printf(text, "%s%s", text->len ? "; " : "",
                               task->text ? task->text : safe_state_name(work->state, i));
    }
    return g_string_free(text, FALSE);
}

gboolean safe_work_once(const SafeState *state, gboolean *ret_hope) {
    SafeWork *work = safe_work_new(state, SAFE_UNTIL_TIRED, 0);

    while (safe_work_run(work, NULL, 0, -1))
        continue;
    const gboolean safe = safe_work_is_safe(work);
    *ret_hope = FALSE;
    for (int i = 0; i < safe_state_n(state); i++)
        *ret_hope |= work->tasks[i].hope;
    safe_work_free(work);
    return safe;
}
