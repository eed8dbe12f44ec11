#include "schedule.h"

#include <math.h>
#include <string.h>

static const char *const kind_names[] = {
    [DISK_OPEN] = "open",         [DISK_READ] = "read",     [DISK_WRITE] = "write",
    [DISK_SYNC] = "sync",         [DISK_RENAME] = "rename", [DISK_REMOVE] = "remove",
    [DISK_TRUNCATE] = "truncate", [DISK_FOLDER] = "mkdir",  [DISK_ANY] = "disk call",
};

static const char *const call_names[] = {
    [CALL_PAUSE] = "an operator pauses",
    [CALL_CONTINUE] = "an operator continues",
    [CALL_ABORT] = "an operator aborts",
    [CALL_STATUS] = "somebody asks for the status",
    [CALL_THUMBNAIL] = "somebody asks for a thumbnail",
    [CALL_READ] = "another program reads the session",
    [CALL_REOPEN] = "the session is closed and resumed",
    [CALL_SECOND] = "a second daemon tries to resume the session",
    [CALL_STEP] = "the wall clock is set",
    [CALL_KILL] = "the daemon is killed",
    [CALL_CUT] = "the power fails",
    [CALL_SAFE] = "an operator calls for the safe state",
};

/* How often each kind of call is drawn, and about how many of them a whole session makes. */
static const struct {
    enum disk_kind kind;
    int weight, most;
} disk_kinds[] = {
    {DISK_OPEN, 1, 200},    {DISK_READ, 1, 400},  {DISK_WRITE, 3, 900},
    {DISK_SYNC, 4, 160},    {DISK_RENAME, 2, 30}, {DISK_REMOVE, 1, 10},
    {DISK_TRUNCATE, 1, 10}, {DISK_FOLDER, 1, 5},  {DISK_ANY, 6, 1600},
};

/* Early and late calls are as likely: a log-uniform number of 1 … most. */
static int draw_at(GRand *random, int most) {
    if (g_rand_boolean(random))
        return g_rand_int_range(random, 1, most + 1);
    return (int)exp(g_rand_double(random) * log(most)) + g_rand_int_range(random, 0, 2);
}

static void draw_disk(GRand *random, struct disk_fault *fault) {
    int weights = 0, drawn;
    gsize i = 0;
    for (gsize k = 0; k < G_N_ELEMENTS(disk_kinds); k++)
        weights += disk_kinds[k].weight;
    for (drawn = g_rand_int_range(random, 0, weights); drawn >= disk_kinds[i].weight; i++)
        drawn -= disk_kinds[i].weight;
    static const enum disk_action actions[] = {DISK_FAILS, DISK_FAILS, DISK_FULL,
                                               DISK_SHORT, DISK_KILL,  DISK_KILL,
                                               DISK_CUT,   DISK_CUT,   DISK_CUT};
    fault->kind = disk_kinds[i].kind;
    fault->at = draw_at(random, disk_kinds[i].most);
    fault->action = actions[g_rand_int_range(random, 0, G_N_ELEMENTS(actions))];
    const gboolean lasts = g_rand_int_range(random, 0, 3) == 0;
    const int calls = g_rand_int_range(random, 2, 60);
    fault->calls = lasts ? calls : 1;
}

G_GNUC_PRINTF(3, 4)
static void add_device(struct life *life, const char *section, const char *format, ...) {
    if (life->n_devices == SCHEDULE_MAX_DEVICES)
        return;
    struct device_fault *fault = &life->devices[life->n_devices++];
    va_list args;
    va_start(args, format);
    fault->section = section;
    g_vsnprintf(fault->line, sizeof fault->line, format, args);
    va_end(args);
}

static void draw_camera(GRand *random, struct life *life) {
    const char *camera = g_rand_boolean(random) ? "[camera cam30]" : "[camera cam60]";
    const double often = g_rand_double_range(random, 0.01, 0.3);
    const int seed = g_rand_int_range(random, 1, 1000), n = g_rand_int_range(random, 1, 60);
    switch (g_rand_int_range(random, 0, 5)) {
    case 0:
        add_device(life, camera, "fault_stale = %.3f", often);
        break;
    case 1:
        add_device(life, camera, "fault_stale = %.3f", often);
        add_device(life, camera, "fault_stale_kind = relabelled");
        break;
    case 2:
        add_device(life, camera, "fault_lost = %.3f", often);
        break;
    case 3:
        add_device(life, camera, "fault_slow_ms = %d", n * 60);
        break;
    default:
        add_device(life, camera, "fault_disconnect_after = %d", n);
        break;
    }
    add_device(life, camera, "fault_seed = %d", seed);
}

static void draw_device(GRand *random, struct life *life) {
    static const char *const axes[] = {"[axis turntable]", "[axis arc]", "[axis sweep30]",
                                       "[axis sweep60]"};
    const char *axis = axes[g_rand_int_range(random, 0, G_N_ELEMENTS(axes))];
    const char *laser = g_rand_boolean(random) ? "[laser laser30]" : "[laser laser60]";
    const gboolean silent = g_rand_boolean(random);
    const int n = g_rand_int_range(random, 1, 8);
    switch (g_rand_int_range(random, 0, 8)) {
    case 0:
        add_device(life, axis, "fault_stall_at = %d", n);
        if (silent)
            add_device(life, axis, "fault_stall_kind = silent");
        break;
    case 1:
        add_device(life, "[lamps bank]", "fault_dead = %s", silent ? "lamp30" : "lamp60");
        add_device(life, "[lamps bank]", "fault_dead_after = %d", n);
        break;
    case 2:
        add_device(life, laser, "fault_stays_on = yes");
        break;
    case 3:
        add_device(life, laser, "fault_deaf = %d", n);
        break;
    case 4:
        add_device(life, "[interlock door]", "open_after_s = %d", g_rand_int_range(random, 1, 40));
        add_device(life, "[interlock door]", "open_for_s = %d", n);
        break;
    default:
        draw_camera(random, life);
        break;
    }
}

static void draw_call(GRand *random, struct call *call) {
    /* Most sessions of the small rig take about 40 s on its clock. */
    call->at_us = (gint64)(g_rand_double_range(random, 0, 45) * 1e6);
    call->kind = (enum call_kind)g_rand_int_range(random, 0, CALL_KINDS);
    /* Up to about three years either way. */
    call->step_s =
        (gint64)(exp(g_rand_double_range(random, 0, 18.4)) * (g_rand_boolean(random) ? 1 : -1));
}

static void draw_life(GRand *random, struct life *life) {
    const int n_devices = g_rand_int_range(random, 0, 3), n_disk = g_rand_int_range(random, 0, 3),
              n_calls = g_rand_int_range(random, 0, SCHEDULE_MAX_CALLS + 1);
    for (int i = 0; i < n_devices; i++)
        draw_device(random, life);
    for (int i = 0; i < n_disk; i++)
        draw_disk(random, &life->disk[life->n_disk++]);
    for (int i = 0; i < n_calls; i++)
        draw_call(random, &life->calls[life->n_calls++]);
    life->patience = g_rand_int_range(random, 0, 4);
    life->cut = (enum cut_mode)g_rand_int_range(random, CUT_LOSES, CUT_EACH + 1);
    life->cut_seed = g_rand_int(random);
    life->rots = g_rand_int_range(random, 0, 10) == 0;
    life->misplaces = g_rand_int_range(random, 0, 6) == 0;
}

void schedule_make(struct schedule *schedule, guint32 seed) {
    /* Seeds that follow each other give unrelated numbers. */
    const guint32 words[] = {seed, 0x6d657369};
    g_autoptr(GRand) random = g_rand_new_with_seed_array(words, G_N_ELEMENTS(words));
    /* One seed in ten has the last session, which takes longer; the others take turns. */
    *schedule = (struct schedule){
        .seed = seed,
        .session = seed % 10 == 5 ? SCHEDULE_SESSIONS - 1 : (int)(seed % (SCHEDULE_SESSIONS - 1))};
    schedule->n_lives = g_rand_int_range(random, 1, SCHEDULE_MAX_LIVES + 1);
    for (int i = 0; i < schedule->n_lives; i++) {
        /* A generator of its own for each: what one life draws does not shift the next. */
        g_autoptr(GRand) own = g_rand_new_with_seed(g_rand_int(random));
        draw_life(own, &schedule->lives[i]);
    }
}

const char *schedule_disk_kind(enum disk_kind kind) {
    return kind_names[kind];
}

const char *schedule_call_kind(enum call_kind kind) {
    return call_names[kind];
}

static void describe_disk(GString *to, const struct disk_fault *fault) {
    static const char *const actions[] = {
        [DISK_FAILS] = "fails with EIO",           [DISK_FULL] = "finds the disk full",
        [DISK_SHORT] = "is done by half",          [DISK_KILL] = "is preceded by SIGKILL",
        [DISK_CUT] = "is preceded by a power cut",
    };
    g_string_append_printf(to, "  disk: %s %d", kind_names[fault->kind], fault->at);
    if (fault->calls > 1)
        g_string_append_printf(to, " to %d", fault->at + fault->calls - 1);
    g_string_append_printf(to, " %s\n", actions[fault->action]);
}

char *schedule_describe(const struct life *life) {
    static const char *const cuts[] = {"loses all unsynced data", "keeps all unsynced data",
                                       "keeps, loses or tears each unsynced write"};
    GString *to = g_string_new(NULL);
    for (int i = 0; i < life->n_devices; i++)
        g_string_append_printf(to, "  devices: %s %s\n", life->devices[i].section,
                               life->devices[i].line);
    for (int i = 0; i < life->n_disk; i++)
        describe_disk(to, &life->disk[i]);
    for (int i = 0; i < life->n_calls; i++) {
        const struct call *call = &life->calls[i];
        g_string_append_printf(to, "  at %.3f s: %s", (double)call->at_us * 1e-6,
                               call_names[call->kind]);
        if (call->kind == CALL_STEP)
            g_string_append_printf(to, " %+" G_GINT64_FORMAT " s", call->step_s);
        g_string_append_c(to, '\n');
    }
    g_string_append_printf(to, "  patience: %d; a power cut %s%s%s\n", life->patience,
                           cuts[life->cut], life->misplaces ? ", and misplaces a write" : "",
                           life->rots ? "; a bit rots" : "");
    return g_string_free(to, FALSE);
}
