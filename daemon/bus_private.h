/*
 * What bus.c (the rig, and the session that is being captured), bus_thumbnails.c (the cameras' last
 * pictures) and bus_calls.c (what methods of org.mesorig.Rig1 answer) share.
 */
#pragma once

#include "bus.h"
#include "capture.h"
#include "follower.h"
#include "guardian.h"
#include "rig1-bus.h"

struct Bus {
    BusRig1 *object;
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
    GHashTable *faults;       /* device name to message */
    gint64 started_us;        /* real time */
    double started_elapsed_s; /* on the rig's clock */
    double thumbnail_time_s[RIG_MAX_CAMERAS];
    gint64 thumbnail_sent_us[RIG_MAX_CAMERAS];
    struct capture_thumbnail kept[RIG_MAX_CAMERAS]; /* the last of a capture that has ended */
    guint end_id; /* the idle call that lets go of a capture that has ended */
    BusFunc func;
    gpointer data;
    GDBusConnection *client; /* who runs this; only compared */
    BusFunc client_gone;
    gpointer client_data;
};

/* Errors BUS_ERROR_NO_RIG and BUS_ERROR_NO_SESSION. */
gboolean bus_need_rig(Bus *bus, GError **error);
gboolean bus_need_capture(Bus *bus, GError **error);

/* As the methods of these names. session_path NULL: as Resume. directory of bus_validate() may be
 * empty. bus_validate() returns a report of report.h, g_variant_unref(). */
void bus_close_rig(Bus *bus);
GVariant *bus_validate(Bus *bus, const char *session_path, const char *directory, GError **error);
gboolean bus_start(Bus *bus, const char *session_path, const char *directory, GVariant *options,
                   GError **error);
gboolean bus_make_safe(Bus *bus, GError **error);

/* Tells of cameras with a new picture, of each once a second at most. */
void bus_show_thumbnails(Bus *bus);

/* The last pictures of a capture that ends stay, until they are dropped. */
void bus_keep_thumbnails(Bus *bus);
void bus_drop_thumbnails(Bus *bus);

/* The camera's last picture, owned by bus and good until the main loop runs. */
const struct capture_thumbnail *bus_thumbnail(Bus *bus, const char *camera, GError **error);

/* Connects the handlers of all methods. */
void bus_answer_calls(Bus *bus);
