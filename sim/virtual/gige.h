/*
 * A virtual GigE Vision camera that speaks the real protocol on the loopback interface, in threads
 * of its own and in real time: GVCP with discovery, registers, heartbeat and packet resend, GVSP
 * with test packets, and a GenICam file that it serves itself. Pictures come from whoever makes it.
 *
 * Aravis has a fake camera too, but without resend, time stamp latch, exposure that takes time and
 * a trigger line, and with its control channel silent while a picture is made; none of these could
 * be tested with it.
 *
 * Any address of 127.0.0.0/8 will do; no network has to be set up. Any thread may call these
 * functions, except new and free.
 */
#pragma once

#include "drivers/frame.h"

#include <gio/gio.h>

typedef struct VirtualGige VirtualGige;

struct virtual_gige_exposure {
    guint64 n;                    /* counts the pictures of this camera from 1 */
    gint64 start_us, exposure_us; /* of g_get_monotonic_time() */
    double gain_db;
};

/* Called in the camera's own thread when an exposure is over. pixels holds height × width values of
 * the sensor's bits, at a black level of options.black_level. */
typedef void (*VirtualGigePicture)(const struct virtual_gige_exposure *exposure, gpointer data,
                                   guint16 *ret_pixels);

struct virtual_gige_options {
    const char *address; /* "127.0.0.9"; NULL: a free one */
    const char *serial;  /* up to 15 characters */
    int width, height, bits;
    enum cfa cfa;
    double black_level;         /* what its BlackLevel says at first, in DN of the sensor */
    VirtualGigePicture picture; /* NULL: a ramp that differs from picture to picture */
    gpointer data;
};

/* Errors: the address is in use. */
VirtualGige *virtual_gige_new(const struct virtual_gige_options *options, GError **error);
void virtual_gige_free(VirtualGige *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualGige, virtual_gige_free)

/* What a section writes for "device"; "GE-" and the serial number work too. */
const char *virtual_gige_address(const VirtualGige *camera);

/* How it fails from now on. Counts run down. */
struct virtual_gige_faults {
    double loss;         /* part of the packets of pictures that is lost on the way */
    gboolean no_resend;  /* what is asked for again does not come */
    int cut;             /* pictures that end in the middle, and cannot be asked for again */
    int blind;           /* triggers that are acknowledged and make no picture */
    int old;             /* pictures that are the one before, with its time stamp */
    gint64 ahead_us;     /* time stamps of pictures are so much in the future */
    gint64 late_us;      /* pictures leave so much later */
    gboolean unplugged;  /* nothing comes through */
    int odd;             /* pictures that say they are narrower than they are */
    gboolean stamps_end; /* time stamps mark the end of the exposure, as some makers' do */
    gint64 slow_us;      /* from the trigger to the exposure */
    gboolean announces;  /* the first packet of a picture leaves when it is triggered, too */
    int mtu;             /* larger packets do not get through; 0: all do */
    gint64 answer_us;    /* every answer on its control channel is so late */
    double rounding_us;  /* exposures are multiples of this; 0: of 1 µs */
};
void virtual_gige_fail(VirtualGige *camera, const struct virtual_gige_faults *faults);

/* Another program takes control, and gives it back when steal is FALSE. */
void virtual_gige_steal(VirtualGige *camera, gboolean steal);

/* Power off and, after down_ms, on again, with all registers as they were at first. */
void virtual_gige_restart(VirtualGige *camera, int down_ms);

/* A pulse on its input, "Line0". */
void virtual_gige_pulse(VirtualGige *camera);

struct virtual_gige_state {
    gboolean controlled, acquiring, automatic; /* automatic: it sets its exposure itself */
    int packet_size, pixel_format;
    gint64 exposure_us;
    double gain_db, black_level;
    gint64 triggered_us;      /* the last trigger that began an exposure */
    guint64 triggers, missed; /* missed: came while it still exposed */
    guint64 pictures, packets, lost, resent;
};
void virtual_gige_state(VirtualGige *camera, struct virtual_gige_state *ret);
