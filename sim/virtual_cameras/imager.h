/*
 * Shared by virtual GenICam cameras on all buses: their description, the source of their pictures,
 * their faults and their counts.
 */
#pragma once

#include "drivers/frame.h"

struct virtual_exposure {
    guint64 n;                    /* counts the pictures of this camera from 1 */
    gint64 start_us, exposure_us; /* of g_get_monotonic_time() */
    double gain_db;
};

/* Called in the camera's own thread when an exposure is over. pixels holds height × width values of
 * the sensor's bits, at a black level of options.black_level. */
typedef void (*VirtualPicture)(const struct virtual_exposure *exposure, gpointer data,
                               guint16 *ret_pixels);

#define VIRTUAL_PROCESSING 16

/* A function that alters pictures, as in makers' description files: while any of its registers
 * differs from its neutral value, brightness is squared. Must outlive the camera. */
struct virtual_processing {
    const char *xml; /* elements of a GenICam file, with a category ImageProcessing */
    /* Registers of 4 bytes from 0x1140 on. */
    guint32 first[VIRTUAL_PROCESSING], neutral[VIRTUAL_PROCESSING];
    guint fixed;       /* bit i: register i keeps its value, whatever is written to it */
    gboolean grey_too; /* a colour camera offers Mono formats beside its Bayer formats */
};

struct virtual_camera_options {
    const char *serial; /* up to 15 characters */
    int width, height, bits;
    enum cfa cfa;
    double black_level;     /* what its BlackLevel says at first, in DN of the sensor */
    VirtualPicture picture; /* NULL: a ramp that differs from picture to picture */
    gpointer data;
    const struct virtual_processing *processing; /* NULL: none */
};

/* Faults from now on. Counts run down. */
struct virtual_camera_faults {
    int cut;             /* pictures that end in the middle, and cannot be asked for again */
    int blind;           /* triggers that are acknowledged and make no picture */
    int old;             /* pictures that repeat the previous one, with its time stamp */
    gint64 ahead_us;     /* time stamps of pictures are this far in the future */
    gint64 late_us;      /* extra delay before a picture is sent */
    int odd;             /* pictures that say they are narrower than they are */
    gboolean stamps_end; /* time stamps mark the end of the exposure, as some makers' do */
    gint64 slow_us;      /* from the trigger to the exposure */
    gboolean announces;  /* the first packet of a picture leaves when it is triggered, too */
    gint64 answer_us;    /* delay of each answer on the control channel */
    double rounding_us;  /* exposures are multiples of this; 0: of 1 µs */

    /* GigE Vision alone. */
    double loss;        /* part of the packets of pictures that is lost on the way */
    gboolean no_resend; /* requested packets are not sent again */
    gboolean unplugged; /* nothing comes through */
    int mtu;            /* larger packets do not get through; 0: all do */

    /* USB3 Vision alone. */
    int headless; /* pictures without their leader */
    int tailless; /* pictures without their trailer */
    int stunted;  /* pictures whose trailer ends in its middle */
    int hollow;   /* leaders and trailers with no picture between them */
};

struct virtual_camera_state {
    gboolean controlled, acquiring, automatic; /* automatic: it sets its exposure itself */
    int packet_size, pixel_format;             /* packet_size: GigE Vision alone */
    gint64 exposure_us;
    double gain_db, black_level;
    gint64 triggered_us;           /* the last trigger that began an exposure */
    guint64 triggers, missed;      /* missed: came while it still exposed */
    guint64 pictures;              /* sent */
    guint64 packets, lost, resent; /* GigE Vision alone */
    guint processing;              /* bit i: register i of it is not neutral */
};
