/*
 * The sessions that a rig is to capture one after the other, without anybody beside it: a list, and
 * the file that keeps it. Knows no device; daemon/bus/bus_unattended.c captures them.
 *
 * Every change is on disk, synced, when the function that makes it returns; if it could not be
 * written, the list is as it was before. The file belongs to this program's user alone (mode 0600):
 * one that others could have written is not read, since it says on whose behalf sessions are
 * captured and where. A file that cannot be read is kept beside the new one, under the name
 * FILE.damaged. Main loop's thread.
 */
#pragma once

#include <gio/gio.h>

#define QUEUE_MOST       200        /* sessions, those that have ended counted */
#define QUEUE_MOST_BYTES (32 << 20) /* of the file */

typedef struct Queue Queue;

enum queue_state {
    QUEUE_WAITING,
    QUEUE_HANDS,  /* somebody is to do what the prompt says; in the file: waiting */
    QUEUE_TRYING, /* test shots are taken; in the file: waiting */
    QUEUE_BEGUN,
    QUEUE_DONE,
    QUEUE_STOPPED, /* it did not begin or did not come to its end; the message says why */
    QUEUE_STATES,
};
extern const char *const queue_state_names[QUEUE_STATES];

/* A session of the queue. Strings are never NULL. */
struct queue_item {
    guint id; /* never given twice in the life of a file */
    enum queue_state state;
    char *name;                           /* of the session, from its file */
    char *session_path, *session_text;    /* the file that was handed over, and what was in it */
    char *directory;                      /* the session directory to make, absolute */
    char *rig;                            /* path of the rig file that it was checked against */
    char *calibration, *calibration_text; /* in place of the rig's; empty: the rig's own */
    char *prompt;                         /* what somebody has to do before it; empty: nothing */
    char *chosen;                         /* session_conf_choose(); empty: nothing yet */
    char *message;                        /* why it has stopped */
    double predicted_s;
    guint64 bytes;                 /* predicted */
    int starts;                    /* how often it has begun without an orderly end */
    gboolean process;              /* make the products beside the capture */
    gboolean yes;                  /* go on whatever test shots say */
    gint64 begun_at_s, ended_at_s; /* since 1970; 0: not yet */
    gboolean has_caller;           /* FALSE: this program's own user or root has added it */
    guint32 uid;                   /* of whoever has added it */
    GArray *groups;                /* of guint32 */
};

struct queue_item *queue_item_new(void); /* all strings empty */
void queue_item_free(struct queue_item *item);

typedef struct queue_item QueueItem;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(QueueItem, queue_item_free)

/* Reads the file, which need not exist yet; its folder must. A session that had begun waits again.
 * NULL: another process has the file open. */
Queue *queue_open(const char *path, GError **error);
void queue_free(Queue *queue); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Queue, queue_free)

/* The sessions in their order, as struct queue_item; those that have ended come first. Owned by the
 * queue. */
const GPtrArray *queue_items(const Queue *queue);
struct queue_item *queue_find(const Queue *queue, guint id, GError **error);
struct queue_item *queue_next(const Queue *queue); /* the first that waits, or NULL */

/* Why nothing further begins; NULL: it goes on. Owned by the queue. */
const char *queue_paused(const Queue *queue);
gboolean queue_pause(Queue *queue, const char *why, GError **error); /* why NULL: goes on */

/* Takes the item, in any case, and gives it a number. Refuses a directory that another session of
 * the queue is to be captured into. */
gboolean queue_add(Queue *queue, struct queue_item *item, GError **error);

/* Removes a session; refuses one that has begun or is about to begin. */
gboolean queue_remove(Queue *queue, guint id, GError **error);

/* Moves a session to this place, from 1 on, among those that wait; a place beyond them is the
 * end. */
gboolean queue_move(Queue *queue, guint id, guint place, GError **error);

/* Sets state and message (NULL: none). On failure the list is changed all the same, and the next
 * change writes it: what has happened has happened. */
gboolean queue_set(Queue *queue, struct queue_item *item, enum queue_state state,
                   const char *message, GError **error);
