/*
 * The simulated disk: calls of the C library that read and change files below one folder are
 * counted, made to fail as a schedule says, and written down, so that a power cut can be played
 * back on the folder (disk_model.h). disk_calls.c defines those functions in the program itself,
 * so that GLib, SQLite and OpenEXR call them as well. Everywhere else they do nothing.
 *
 * The journal is memory that a process shares with those that it forks: it outlives a killed one.
 */
#pragma once

#include "drivers/clock.h"
#include "schedule.h"

#include <sys/types.h>

#define DISK_JOURNAL_BYTES ((gsize)256 << 20)
#define DISK_SAID_BYTES    ((gsize)1 << 20)

/* A change of the disk, in a journal. Followed by its name, other name and data. */
struct disk_entry {
    gsize bytes; /* of all of it, rounded up to a multiple of 8 */
    enum {
        ENTRY_FILE, /* made: name */
        ENTRY_FOLDER,
        ENTRY_WRITE, /* data at offset */
        ENTRY_SIZE,  /* offset is the new length */
        ENTRY_SYNC,  /* of a file or a folder */
        ENTRY_SYNC_FAILED,
        ENTRY_RENAME, /* name to other */
        ENTRY_REMOVE, /* name */
    } kind;
    guint64 inode;
    gint64 offset;
    gsize n_name, n_other, n_data; /* names without their ends */
};

struct disk {
    char root[256]; /* absolute, without links */
    struct disk_fault faults[SCHEDULE_MAX_DISK];
    int n_faults;
    int calls[DISK_COUNTS]; /* of each kind, and of all */
    gboolean active, full;
    gboolean cut;    /* the process was killed, and the power failed as well */
    int n_failed;    /* calls that were made to fail, or while the disk was full */
    gint64 ended_us; /* when, on the rig's clock, a life was over */
    gint64 step_s;   /* by which the wall clock was set */
    guint64 digest;  /* of every call, its kind and its file, and of what was said */
    gsize n_said, n_journal;
    char said[DISK_SAID_BYTES]; /* what happened, a line each */
    guint64 journal[DISK_JOURNAL_BYTES / sizeof(guint64)];
};

/* From now on, in this process and those it forks. NULL: no more. */
void disk_use(struct disk *disk);

/* The clock that wall time and what is said follow in this process. */
void disk_set_clock(const Clock *clock);

/* What is said without what differs from run to run: the disk's folder is called DISK, process ids
 * N, random parts of names are question marks. g_free() */
char *disk_neutral(const struct disk *disk, const char *text);

/* Adds a line to what happened, with the rig's time, neutral. */
void disk_say(struct disk *disk, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Ends this process at the same time, as SIGKILL and power cuts do. */
G_NORETURN void disk_kill(struct disk *disk, gboolean cut);
