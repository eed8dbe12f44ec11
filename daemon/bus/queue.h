/*
 * The sessions that a rig is to capture one after the other without supervision: a list, and the
 * file that keeps it. This module knows no device. bus_unattended.c captures the sessions.
 *
 * When a function that changes the list returns, the change is on disk and synced. If the change
 * could not be written, the list is as it was before, except after queue_set() and after
 * queue_pause() with a reason. The file belongs only to the user of this program (mode 0600). A
 * file that other users could have written is not read, because the file says for which user
 * sessions are captured, and into which directories. A file that cannot be used is renamed to
 * FILE.damaged, and the queue begins empty and paused. All functions belong to the main loop's
 * thread.
 */
#pragma once

#include <glib.h>

#define QUEUE_MAX       200        /* largest number of sessions, including those that have ended */
#define QUEUE_MAX_BYTES (32 << 20) /* largest size of the file */

typedef struct Queue Queue;

enum queue_state {
    QUEUE_WAITING,
    QUEUE_HANDS,  /* a user must do what the prompt says; stored in the file as waiting */
    QUEUE_TRYING, /* test shots are taken; stored in the file as waiting */
    QUEUE_BEGUN,
    QUEUE_DONE,
    QUEUE_STOPPED, /* the session did not begin or did not finish; the message says why */
    QUEUE_STATES,
};
extern const char *const queue_state_names[QUEUE_STATES];

/* A session of the queue. Its strings are never NULL. */
struct queue_item {
    guint id; /* number of the item; a file never uses a number twice */
    enum queue_state state;
    char *name;                        /* name of the session, from its file */
    char *session_path, *session_text; /* path and contents of the session file */
    char *directory;                   /* absolute path of the session directory to be made */
    /* Path of the rig file against which the session was checked. */
    char *rig;
    /* Path and contents of a calibration that replaces the one of the rig. Both are empty if the
     * calibration of the rig is used. */
    char *calibration, *calibration_text;
    /* What a user must do before the session; empty for nothing. */
    char *prompt;
    /* Lines for session_conf_choose(); empty if nothing is chosen yet. */
    char *chosen;
    char *message; /* reason why the session has stopped; empty in other states */
    double predicted_s;
    guint64 bytes; /* predicted size of the session */
    /* number of times that the session began since the last orderly end of this program */
    int starts;
    gboolean process; /* process the session during the capture */
    gboolean yes;     /* continue even if the test shots give warnings */
    /* Times at which the session began and ended, in seconds since 1970. A time is 0 before the
     * event. */
    gint64 begun_at_s, ended_at_s;
    gboolean has_caller; /* FALSE if this program's own user or root has added the session */
    guint32 uid;         /* user who has added it */
    GArray *groups;      /* of guint32; the groups of that user */
};

struct queue_item *queue_item_new(void); /* all strings empty */
void queue_item_free(struct queue_item *item);

typedef struct queue_item QueueItem;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(QueueItem, queue_item_free)

/* Opens the queue in a file. The file need not exist yet, but its folder must. A session that had
 * begun waits again. Returns NULL with an error if the file cannot be locked, for instance because
 * another process has the queue open. */
Queue *queue_open(const char *path, GError **error);
void queue_free(Queue *queue); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Queue, queue_free)

/* Returns the sessions in the order of the queue, as struct queue_item. Sessions that have ended
 * come first. The queue owns the array. */
const GPtrArray *queue_items(const Queue *queue);
/* Returns the session with this number. Returns NULL with an error if there is none. The queue owns
 * the session. */
struct queue_item *queue_find(const Queue *queue, guint id, GError **error);
/* Returns the first session that has not ended, or NULL. The queue owns the session. */
struct queue_item *queue_next(const Queue *queue);

/* Returns the reason why no further session begins, or NULL if the queue is not paused. The queue
 * owns the string. */
const char *queue_paused(const Queue *queue);
/* Pauses the queue for the reason `why`. If `why` is NULL, ends the pause. */
gboolean queue_pause(Queue *queue, const char *why, GError **error);

/* Adds an item and gives it a number. Takes ownership of the item in any case. Fails if a
 * session that has not ended has the same directory, if too many sessions wait, or if the file
 * cannot be written. */
gboolean queue_add(Queue *queue, struct queue_item *item, GError **error);

/* Removes a session. Fails if there is no session of this number, if the session is being
 * captured or its test shots are being taken, or if the file cannot be written. */
gboolean queue_remove(Queue *queue, guint id, GError **error);

/* Moves a session to a place, counted from 1, among the sessions that wait. A place beyond the
 * last of these sessions means the end of the queue. Fails for the place 0, for a session that
 * has ended, and in the cases of queue_remove(). */
gboolean queue_move(Queue *queue, guint id, guint place, GError **error);

/* Sets state and message of a session; message may be NULL. If the file cannot be written, the
 * list is changed nevertheless, because the event has already happened. The next change then
 * writes it. */
gboolean queue_set(Queue *queue, struct queue_item *item, enum queue_state state,
                   const char *message, GError **error);
