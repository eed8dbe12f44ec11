/*
 * Shared by bus.c (the rig, and the session that is being captured), bus_thumbnails.c (the cameras'
 * last pictures), bus_calls.c (what methods of org.mesorig.Rig1 answer), bus_jobs.c (calls that a
 * child works for), bus_hands.c (devices by hand), bus_latch.c (the safe state), bus_unattended.c
 * (the queue of sessions), bus_queue.c (calls that wait) and bus_authority.c (who may call what).
 */
#pragma once

#include "bus.h"
#include "capture/capture.h"
#include "capture/follower.h"
#include "preparer.h"
#include "rig/guardian.h"
#include "rig1-bus.h"

struct bus_latch;
struct bus_queue;
struct queue_item;
struct unattended;
struct bus_caller;

struct Bus {
    BusRig1 *object;
    struct bus_latch *latch; /* of the safe state (bus_latch.h) */
    struct bus_queue *queue; /* of calls */
    struct unattended *unattended;
    GPtrArray *jobs;      /* of struct bus_job, owned by what they wait for */
    GPtrArray *questions; /* to polkit (bus_authority.c), owned by what they wait for */
    struct preparer_limits limits[PREPARER_TASKS];
    char *address;
    struct devices *devices; /* NULL: closed */
    char *rig_path;
    Guardian *guardian; /* NULL: all is simulated */
    gboolean ending;    /* the rig is being made safe for good: nothing begins any more */
    gboolean is_safe;   /* it has been, and was read back */
    gboolean holds_clock;
    Capture *capture; /* NULL: nothing under way, not even paused */
    char *directory;  /* of the session that is or was captured */
    Follower *follower;
    GPtrArray *hands; /* of struct hand: devices that somebody has in hand (bus_hands.h) */
    guint hand_interlocks[DEVICES_MAX_INTERLOCKS];
    GHashTable *faults;       /* device name to message */
    GHashTable *unsafe;       /* device ("laser top") to what it has not confirmed */
    gint64 started_us;        /* real time */
    double started_elapsed_s; /* on the rig's clock */
    double thumbnail_time_s[RIG_MAX_CAMERAS];
    gint64 thumbnail_sent_us[RIG_MAX_CAMERAS];
    struct capture_thumbnail kept[RIG_MAX_CAMERAS]; /* the last of a capture that has ended */
    guint tick_id; /* shows the time that passes, during a capture */
    guint end_id;  /* the idle source that frees a capture that has ended */
    BusFunc func;
    gpointer data;
    GDBusConnection *client; /* the client that started it; only compared */
    BusFunc client_gone;
    gpointer client_data;
};

/* Errors BUS_ERROR_NO_RIG and BUS_ERROR_NO_SESSION. */
gboolean bus_need_rig(Bus *bus, GError **error);
gboolean bus_need_capture(Bus *bus, GError **error);

/* Errors BUS_ERROR_BUSY and BUS_ERROR_BAD_PATH. */
gboolean bus_need_free(Bus *bus, GError **error);
gboolean bus_need_absolute(const char *path, GError **error);

/* Sends an event to all clients and the log; one of level "error" also becomes the fault of a
 * device. */
void bus_report(Bus *bus, const char *level, const char *source, const char *message);
void bus_show_devices(Bus *bus);

/* A simulated rig's time stands still until something is asked of it: otherwise faults that it
 * simulates after some seconds could occur before the first call. */
void bus_hold_clock(Bus *bus, gboolean hold);

/* Holds the clock, unless something is under way or a device has yet to confirm that it is off. */
void bus_rest_clock(Bus *bus);

/* Ends all that is under way, and waits until every device of a rig with real devices has confirmed
 * that it is off or stands. Error BUS_ERROR_BUSY: one has not; the rig stays open, and the device
 * is commanded until it confirms. Runs the main loop. */
gboolean bus_can_close(Bus *bus, GError **error);

/* Closes the rig. Devices that have not confirmed are left to the guardian, and are not closed,
 * since closing them would wait for their answers while the lines are not free for the guardian.
 * The program ends then. */
void bus_close_rig(Bus *bus);

/* Ends all that is under way, and commands every device off or to a stop. A device that does not
 * confirm it appears in the property Unsafe. A rig is open. */
void bus_make_safe(Bus *bus);

/* Replies to a call that did not reach the skeleton. body: floating or owned by the caller, or
 * NULL. Takes the error. Any thread. */
void bus_reply(GDBusConnection *connection, GDBusMessage *message, GVariant *body, GError *error);

/* Captures into a session directory that a job has made, or (resumed) examined. warning may be
 * NULL. */
gboolean bus_begin(Bus *bus, const char *directory, gboolean resumed, const char *warning,
                   gboolean process, GError **error);

/* Each does the work of the method of the same name in a child, and answers the call when the child
 * has ended. FALSE: refused at once; the caller of this function answers with the error.
 * session_path NULL: does the work of Resume. */
gboolean bus_validate(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                      const char *directory, GVariant *options, GError **error);
gboolean bus_start(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                   const char *directory, GVariant *options, GError **error);

/* Checks a session and adds it to the queue, as the method QueueAdd does. */
gboolean bus_add_to_queue(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                          const char *directory, GVariant *options, GError **error);

/* Begins or goes on with a session of the queue in a child, as Start and Resume do. begun is called
 * once, from the main loop or from bus_jobs_stop_…(); error NULL: the session is being captured. */
typedef void (*BusBegun)(Bus *bus, const GError *error);
void bus_start_queued(Bus *bus, const struct queue_item *item, gboolean resumes, BusBegun begun);

/* The session directory of a Start or Resume that has not been answered yet, or NULL. */
const char *bus_jobs_beginning(Bus *bus);

/* Each answers calls with BUS_ERROR_CANCELLED and kills their children. The first ends a Start
 * or Resume (FALSE: there is none), the second all calls, the third those of a client that has
 * gone. */
gboolean bus_jobs_stop_begin(Bus *bus, const char *why);
void bus_jobs_stop_all(Bus *bus, const char *why);
void bus_jobs_stop_client(Bus *bus, GDBusConnection *connection);

/* Watches over the calls that wait for the main loop: SafeState goes to the latch, and a client
 * that has too many of the others waiting is refused. */
struct bus_queue *bus_queue_new(struct bus_latch *latch);
void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection);
void bus_queue_close(struct bus_queue *queue); /* the bus is being closed */

/* Signals cameras with a new picture, each at most once per second. */
void bus_show_thumbnails(Bus *bus);

/* Keeps the last pictures of a capture that ends, until they are dropped. */
void bus_keep_thumbnails(Bus *bus);
void bus_drop_thumbnails(Bus *bus);

/* The camera's last picture, owned by bus and good until the main loop runs. */
const struct capture_thumbnail *bus_thumbnail(Bus *bus, const char *camera, GError **error);

/* Connects the handlers of all methods. */
void bus_answer_calls(Bus *bus);
