/*
 * The sessions that a rig is to capture one after the other without supervision. This module keeps
 * them in a list and in a file. It knows no device; bus_unattended.c captures the sessions. All
 * functions belong to the main loop's thread.
 *
 * When a function that changes the list returns, the change is on disk and synced. If the change
 * cannot be written, the list is as it was before, with two exceptions: queue_set(), and
 * queue_pause() with a reason, have changed the list even then.
 *
 * The file belongs only to the user of this program (mode 0600). It says for which user sessions
 * are captured, and into which directories. Therefore a file that other users could have written is
 * not read. A file that cannot be used is renamed to FILE.damaged, and the queue begins empty and
 * paused.
 */
#pragma once

#include <glib.h>

#define QUEUE_MAX       200        /* maximum number of sessions, including those that have ended */
#define QUEUE_MAX_BYTES (32 << 20) /* largest size of the file in bytes */

typedef struct Queue Queue;

enum queue_state {
    QUEUE_WAITING,
    QUEUE_HANDS,  /* waits until a user has done what the prompt says; "waiting" in the file */
    QUEUE_TRYING, /* test shots are being taken; "waiting" in the file */
    QUEUE_BEGUN,
    QUEUE_DONE,
    QUEUE_STOPPED, /* the session did not begin or did not finish; the message says why */
    QUEUE_STATES,
};
extern const char *const queue_state_names[QUEUE_STATES];

/* A session of the queue. Its strings are never NULL. */
struct queue_item {
    guint id; /* number of the session; a file never uses a number twice */
    enum queue_state state;
    char *name;                        /* name of the session, from its file */
    char *session_path, *session_text; /* path and contents of the session file */
    /* absolute path of the session directory that will be made */
    char *directory;
    /* Path of the rig file with which the session was checked. */
    char *rig;
    /* Path and contents of a calibration that replaces the one of the rig. Both are empty if the
     * calibration of the rig is used. */
    char *calibration, *calibration_text;
    /* What a user must do before the session; empty if there is nothing to do. */
    char *prompt;
    /* Lines for session_conf_choose(); empty if nothing is chosen yet. */
    char *chosen;
    char *message; /* reason why the session has stopped; empty in other states */
    double predicted_s;
    guint64 bytes; /* predicted size of the session */
    /* Number of times that the session has begun since this program last ended in an orderly
     * way. */
    int starts;
    gboolean process; /* process the session during the capture */
    gboolean yes;     /* continue even if the test shots give warnings */
    /* Times at which the session began and ended, in seconds since 1970; 0 if that has not happened
     * yet. */
    gint64 begun_at_s, ended_at_s;
    gboolean has_caller; /* FALSE if the session was added by root or by the user of this program */
    guint32 uid;         /* user who has added it */
    GArray *groups;      /* of guint32; the groups of that user */
};

struct queue_item *queue_item_new(void); /* all strings empty */
void queue_item_free(struct queue_item *item);

typedef struct queue_item QueueItem;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(QueueItem, queue_item_free)

/* Opens the queue in the file at path. The file need not exist yet, but its folder must. A session
 * that had begun waits again. Returns NULL with an error if the file cannot be locked, for instance
 * because another process has the queue open. */
Queue *queue_open(const char *path, GError **error);
void queue_free(Queue *queue); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Queue, queue_free)

/* Returns all sessions in the order of the queue, as struct queue_item. Sessions that have ended
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

/* Adds an item and gives it a number. Takes ownership of the item, even on failure. Returns FALSE
 * with an error if another session that has not ended has the same directory, if too many sessions
 * wait, or if the file cannot be written. */
gboolean queue_add(Queue *queue, struct queue_item *item, GError **error);

/* Removes a session. Returns FALSE with an error if there is no session of this number, if the
 * session is being captured or its test shots are being taken, or if the file cannot be written. */
gboolean queue_remove(Queue *queue, guint id, GError **error);

/* Moves a session to a place, counted from 1, among the sessions that wait. If there are fewer
 * waiting sessions, the session becomes the last. Returns FALSE with an error for the place 0, for
 * a session that has ended, and in the cases of queue_remove(). */
gboolean queue_move(Queue *queue, guint id, guint place, GError **error);

/* Sets state and message of a session; message may be NULL. If the file cannot be written, returns
 * FALSE with an error, but the list is changed, because the event has already happened. The next
 * change of the list then writes this one too. */
gboolean queue_set(Queue *queue, struct queue_item *item, enum queue_state state,
                   const char *message, GError **error);
