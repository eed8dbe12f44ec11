/*
 * The virtual GenICam cameras on all buses share these structs: description, source of pictures,
 * faults and counters.
 */
#pragma once

#include "drivers/frame.h"

struct virtual_exposure {
    /* number of the picture, counted from 1 since the camera was made */
    guint64 n;
    gint64 start_us, exposure_us; /* start_us is a time of g_get_monotonic_time() */
    double gain_db;
};

/* Sets ret_pixels to height × width values of the sensor, with the sensor's number of bits and the
 * black level options.black_level. Called in the camera's thread when an exposure has ended. */
typedef void (*VirtualPicture)(const struct virtual_exposure *exposure, gpointer data,
                               guint16 *ret_pixels);

#define VIRTUAL_PROCESSING 16

/* A function of a camera that alters pictures, such as cameras of some makers have. While any of
 * its registers differs from its neutral value, brightness is squared. The struct must exist longer
 * than the camera. */
struct virtual_processing {
    const char *xml; /* elements of the GenICam file, with a category ImageProcessing */
    /* Registers of 4 bytes from 0x1140 on. */
    guint32 first[VIRTUAL_PROCESSING], neutral[VIRTUAL_PROCESSING];
    guint fixed;       /* bit i: register i cannot be changed */
    gboolean grey_too; /* a colour camera offers Mono formats in addition to its Bayer formats */
};

struct virtual_camera_options {
    const char *serial; /* up to 15 characters */
    int width, height, bits;
    enum cfa cfa;
    double black_level;     /* initial value of the camera's BlackLevel, in DN of the sensor */
    VirtualPicture picture; /* NULL for a ramp that differs from picture to picture */
    gpointer data;
    const struct virtual_processing *processing; /* NULL if there is none */
};

/* The faults that virtual_gige_fail() and virtual_u3v_fail() set. Members of type int, except mtu,
 * are numbers of pictures or triggers to which the fault will happen. The number decreases by one
 * each time. */
struct virtual_camera_faults {
    int cut;             /* pictures that end in the middle, and whose packets are not resent */
    int blind;           /* triggers that are acknowledged but make no picture */
    int old;             /* pictures that repeat the previous one, with its time stamp */
    gint64 ahead_us;     /* time by which time stamps of pictures lie in the future */
    gint64 late_us;      /* extra delay before a picture is sent */
    int odd;             /* pictures that report a smaller width than they have */
    gboolean stamps_end; /* time stamps mark the end of the exposure, as with some makers */
    gint64 slow_us;      /* delay from the trigger to the exposure */
    gboolean announces;  /* the first packet of a picture is sent at the trigger */
    gint64 answer_us;    /* delay of each answer on the control channel */
    double rounding_us;  /* exposures are rounded to multiples of this time; 0 means 1 µs */

    /* Only for GigE Vision. */
    double loss;        /* share of the pictures' packets that is lost, 0 … 1 */
    gboolean no_resend; /* packets are not resent on request */
    gboolean unplugged; /* no packet arrives */
    /* largest size of a packet in bytes; larger packets are lost; 0: no limit */
    int mtu;

    /* Only for USB3 Vision. */
    int headless; /* pictures without their leader */
    int tailless; /* pictures without their trailer */
    int stunted;  /* pictures with a trailer that ends in its middle */
    int hollow;   /* leaders and trailers without a picture between them */
};

struct virtual_camera_state {
    /* `automatic`: the camera sets its exposure itself */
    gboolean controlled, acquiring, automatic;
    int packet_size, pixel_format; /* packet_size is only for GigE Vision */
    gint64 exposure_us;
    double gain_db, black_level;
    gint64 triggered_us; /* time of the last trigger that began an exposure */
    /* `missed` is the number of triggers that came during an exposure */
    guint64 triggers, missed;
    guint64 pictures;              /* number of pictures sent */
    guint64 packets, lost, resent; /* only for GigE Vision */
    guint processing;              /* bit i: register i of the processing is not neutral */
};
