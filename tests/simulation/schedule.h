/*
 * The events in one simulated run, which depend only on the seed: a few lives of the daemon, each
 * with faults of devices and disk, calls of operators, steps of the wall clock, and an end. In the
 * last life there is no fault, and it must finish the session.
 */
#pragma once

#include <glib.h>

#define SCHEDULE_SESSIONS    4
#define SCHEDULE_MAX_LIVES   5
#define SCHEDULE_MAX_DEVICES 3
#define SCHEDULE_MAX_DISK    3
#define SCHEDULE_MAX_CALLS   5

/* Calls to the kernel, counted apart in each life. */
enum disk_kind {
    DISK_OPEN,
    DISK_READ,
    DISK_WRITE,
    DISK_SYNC,
    DISK_RENAME,
    DISK_REMOVE,
    DISK_TRUNCATE,
    DISK_FOLDER, /* mkdir() */
    DISK_KINDS,
    DISK_ANY = DISK_KINDS, /* of a fault: all of them counted together */
    DISK_STAT,             /* lstat(): of tests only; counted apart, and not among all of them */
    DISK_COUNTS,
};

enum disk_action {
    DISK_FAILS, /* EIO; what a failed fsync() should have synced never reaches the medium */
    DISK_FULL,  /* ENOSPC for calls that take space, from this one on for `calls` of them */
    DISK_SHORT, /* half of a write is done */
    DISK_KILL,  /* the process is killed before this call */
    DISK_CUT,   /* the same, and the power fails */
};

struct disk_fault {
    enum disk_kind kind;
    enum disk_action action;
    int at, calls; /* the at-th call of that kind (from 1), and the calls − 1 after it */
};

/* A line for a section of the rig file: one of the simulated devices' options fault_…, or an
 * interlock that opens. */
struct device_fault {
    const char *section;
    char line[48];
};

enum call_kind {
    CALL_PAUSE,
    CALL_CONTINUE,
    CALL_ABORT,
    CALL_STATUS,
    CALL_THUMBNAIL,
    CALL_READ,   /* another program reads the session */
    CALL_REOPEN, /* the session is closed and resumed in the same process */
    CALL_SECOND, /* a second daemon tries to capture into the same session */
    CALL_SAFE,   /* the safe state, as the daemon answers that call */
    CALL_STEP,   /* the wall clock is set */
    CALL_KILL,
    CALL_CUT, /* the power fails */
    CALL_KINDS,
};

struct call {
    gint64 at_us; /* on the rig's clock */
    enum call_kind kind;
    gint64 step_s; /* CALL_STEP */
};

/* What the medium does with unsynced data when the power fails. */
enum cut_mode { CUT_LOSES, CUT_KEEPS, CUT_EACH };

struct life {
    struct device_fault devices[SCHEDULE_MAX_DEVICES];
    struct disk_fault disk[SCHEDULE_MAX_DISK];
    struct call calls[SCHEDULE_MAX_CALLS];
    int n_devices, n_disk, n_calls;
    int patience; /* how often a paused session is continued before the daemon is ended */
    enum cut_mode cut;
    guint32 cut_seed;
    gboolean rots;      /* after this life, one bit of a committed file flips */
    gboolean misplaces; /* when the power fails, one synced write to a file lies elsewhere in it */
};

struct schedule {
    guint32 seed;
    int session; /* which of the sessions, 0 … SCHEDULE_SESSIONS − 1 */
    int n_lives;
    struct life lives[SCHEDULE_MAX_LIVES];
};

void schedule_make(struct schedule *schedule, guint32 seed);

/* A line for each thing that happens in a life; g_free(). */
char *schedule_describe(const struct life *life);

const char *schedule_disk_kind(enum disk_kind kind);
const char *schedule_call_kind(enum call_kind kind);
