/*
 * Shared by the parts of the bus:
 * - bus.c: the rig, and the session that is being captured
 * - bus_thumbnails.c: the cameras' last pictures
 * - bus_calls.c: the answers of the methods of org.mesorig.Rig1
 * - bus_jobs.c: calls whose work a child process does
 * - bus_hands.c: devices by hand
 * - bus_latch.c: the safe state
 * - bus_unattended.c: the queue of sessions
 * - bus_queue.c: calls that wait
 * - bus_authority.c: who may call which method
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
    struct bus_latch *latch; /* latch of the safe state (bus_latch.h) */
    struct bus_queue *queue; /* queue of calls */
    struct unattended *unattended;
    GPtrArray *jobs; /* of struct bus_job; the operation that a job waits for owns it */
    /* Questions to polkit (bus_authority.c). The operation that a question waits for owns it. */
    GPtrArray *questions;
    struct preparer_limits limits[PREPARER_TASKS];
    char *address;
    struct devices *devices; /* NULL if no rig is open */
    char *rig_path;
    Guardian *guardian; /* NULL if all devices are simulated */
    gboolean ending;    /* the rig is being made safe for good: no operation begins any more */
    gboolean is_safe;   /* the rig has been made safe, and its state was read back */
    gboolean holds_clock;
    Capture *capture; /* NULL if no capture is under way or paused */
    char *directory;  /* directory of the session that is or was captured */
    Follower *follower;
    GPtrArray *hands; /* of struct hand: devices that clients use by hand (bus_hands.h) */
    guint hand_interlocks[DEVICES_MAX_INTERLOCKS];
    GHashTable *faults; /* maps the name of a device to a message */
    /* Maps a device ("laser top") to the state that it has not confirmed. */
    GHashTable *unsafe;
    gint64 started_us;        /* real time */
    double started_elapsed_s; /* time on the rig's clock */
    double thumbnail_time_s[RIG_MAX_CAMERAS];
    gint64 thumbnail_sent_us[RIG_MAX_CAMERAS];
    /* The last pictures of a capture that has ended. */
    struct capture_thumbnail kept[RIG_MAX_CAMERAS];
    guint tick_id; /* timer that shows the time during a capture */
    guint end_id;  /* the idle source that frees a capture that has ended */
    BusFunc func;
    gpointer data;
    GDBusConnection *client; /* the client that started the capture; only compared */
    BusFunc client_gone;
    gpointer client_data;
};

/* Return whether a rig is open, and whether a capture is under way. Errors are BUS_ERROR_NO_RIG and
 * BUS_ERROR_NO_SESSION. */
gboolean bus_need_rig(Bus *bus, GError **error);
gboolean bus_need_capture(Bus *bus, GError **error);

/* Return whether no other operation is under way, and whether a path is absolute. Errors are
 * BUS_ERROR_BUSY and BUS_ERROR_BAD_PATH. */
gboolean bus_need_free(Bus *bus, GError **error);
gboolean bus_need_absolute(const char *path, GError **error);

/* Sends an event to all clients and the log. An event of level "error" also becomes the fault of a
 * device. */
void bus_report(Bus *bus, const char *level, const char *source, const char *message);
void bus_show_devices(Bus *bus);

/* Holds the clock of a simulated rig, so that its time stands still until a client requests
 * something. Without this, faults that the rig simulates after some seconds could occur before the
 * first call. */
void bus_hold_clock(Bus *bus, gboolean hold);

/* Holds the clock, unless an operation is under way or a device has not yet confirmed that it is
 * off. */
void bus_rest_clock(Bus *bus);

/* Ends all operations, and waits until every device of a rig with real devices has confirmed that
 * it is off or stands still. The error is BUS_ERROR_BUSY if a device has not confirmed. The rig
 * then stays open, and the device is commanded until it confirms. Runs the main loop. */
gboolean bus_can_close(Bus *bus, GError **error);

/* Closes the rig. Devices that have not confirmed are left to the guardian and are not closed.
 * Closing them would wait for their answers, and the guardian could not use the lines meanwhile.
 * The program ends after this. */
void bus_close_rig(Bus *bus);

/* Ends all operations, and commands every device off or to a stop. A device that does not confirm
 * appears in the property Unsafe. A rig must be open. */
void bus_make_safe(Bus *bus);

/* Replies to a call that did not reach the skeleton. body is floating, owned by the caller, or
 * NULL. Takes ownership of the error. Any thread may call it. */
void bus_reply(GDBusConnection *connection, GDBusMessage *message, GVariant *body, GError *error);

/* Captures into a session directory that a job has made, or that a job has examined if resumed is
 * TRUE. warning may be NULL. */
gboolean bus_begin(Bus *bus, const char *directory, gboolean resumed, const char *warning,
                   gboolean process, GError **error);

/* Each function does the work of the method of the same name in a child process, and answers the
 * call when the child has ended. It returns FALSE if the call is refused immediately; its caller
 * then answers with the error. bus_start() does the work of Resume if session_path is NULL. */
gboolean bus_validate(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                      const char *directory, GVariant *options, GError **error);
gboolean bus_start(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                   const char *directory, GVariant *options, GError **error);

/* Checks a session and adds it to the queue, like the method QueueAdd. */
gboolean bus_add_to_queue(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                          const char *directory, GVariant *options, GError **error);

/* Begins or resumes a session of the queue in a child process, like Start and Resume. begun is
 * called once, from the main loop or from a function bus_jobs_stop_…(). error is NULL if the
 * session is being captured. */
typedef void (*BusBegun)(Bus *bus, const GError *error);
void bus_start_queued(Bus *bus, const struct queue_item *item, gboolean resumes, BusBegun begun);

/* Returns the session directory of a Start or Resume that has not been answered yet, or NULL. */
const char *bus_jobs_beginning(Bus *bus);

/* Each function answers calls with BUS_ERROR_CANCELLED and kills their children.
 * bus_jobs_stop_begin() ends a Start or Resume, and returns FALSE if there is none.
 * bus_jobs_stop_all() ends all calls. bus_jobs_stop_client() ends the calls of a client that has
 * disconnected. */
gboolean bus_jobs_stop_begin(Bus *bus, const char *why);
void bus_jobs_stop_all(Bus *bus, const char *why);
void bus_jobs_stop_client(Bus *bus, GDBusConnection *connection);

/* The queue of calls that wait for the main loop. It passes SafeState to the latch, and refuses a
 * call if its client has too many other calls waiting. */
struct bus_queue *bus_queue_new(struct bus_latch *latch);
void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection);
void bus_queue_close(struct bus_queue *queue); /* call it when the bus is being closed */

/* Signals which cameras have a new picture. Each camera is signalled at most once per second. */
void bus_show_thumbnails(Bus *bus);

/* Keeps the last pictures of a capture that ends, until bus_drop_thumbnails(). */
void bus_keep_thumbnails(Bus *bus);
void bus_drop_thumbnails(Bus *bus);

/* Returns the camera's last picture. It is owned by bus and valid until the main loop runs. */
const struct capture_thumbnail *bus_thumbnail(Bus *bus, const char *camera, GError **error);

/* Connects the handlers of all methods. */
void bus_answer_calls(Bus *bus);
