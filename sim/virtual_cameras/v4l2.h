/*
 * Virtual cameras behind umockdev's /dev/video: they answer the kernel's V4L2 ioctls and run freely
 * in real time, as UVC cameras do, with their pictures from the simulated world or from a test. A
 * process sees them only after testbed_enter().
 *
 * A camera has a thread of its own while it streams. The functions here are for the main thread.
 */
#pragma once

#include "world/world.h"

typedef struct VirtualV4l2 VirtualV4l2;

/* Gives what the sensor reads. Called in the camera's thread at the end of an exposure. number
 * counts frames. ret_pixels has height × width values below 2^bits. */
typedef void (*VirtualV4l2Expose)(gpointer user, gint64 start_us, gint64 exposure_us,
                                  double gain_db, guint64 number, guint16 *ret_pixels);

enum virtual_v4l2_stamp { /* the moment that its time stamps mark, and the flag that they carry */
                          VIRTUAL_V4L2_START,      /* the exposure's start, flagged so */
                          VIRTUAL_V4L2_FIRST_DATA, /* time of the first data, flagged as the start
                                                      of exposure, as uvcvideo does */
                          VIRTUAL_V4L2_END,        /* time of the end of the data, flagged as
                                                      such */
};

enum { /* controls that it lacks */
       VIRTUAL_V4L2_NO_EXPOSURE = 1,
       VIRTUAL_V4L2_NO_GAIN = 2,
       VIRTUAL_V4L2_NO_WHITE_BALANCE = 4,
};

struct virtual_v4l2_config { /* zeroes: as said */
    int number;              /* /dev/video0 */
    const char *port;        /* of USB: bus, then a port at each hub; NULL: "2-1" */
    double speed_mbit_s;     /* of all its links; 0: 480 */
    int width, height;       /* 0: 64 × 48; there is no other */
    enum cfa cfa;
    int bits;          /* of the sensor; 0: 12 */
    double frame_rate; /* at first; 0: 100. It can also be set to any up to 1000 */
    enum virtual_v4l2_stamp stamp;
    guint lacks;        /* controls */
    gboolean odd_gamma; /* of 0 to 31, in a unit of its own, not of UVC's 100 to 500 */
    gboolean only_compressed;
    int planes; /* of memory that a frame is spread over, with the multi-planar interface;
                   0: the single-planar interface */
    VirtualV4l2Expose expose; /* NULL: noise on a ramp that depends on the exposure */
    gpointer user;
};

/* Strings are copied. */
VirtualV4l2 *virtual_v4l2_new(const struct virtual_v4l2_config *config);

/* The same with a camera of the world: its size, bits, colours and pictures. */
VirtualV4l2 *virtual_v4l2_new_world(const struct virtual_v4l2_config *config, World *world,
                                    const char *camera, GError **error);
void virtual_v4l2_free(VirtualV4l2 *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualV4l2, virtual_v4l2_free)

/* Gone, as when the cable is pulled, and back as /dev/videoNUMBER. */
void virtual_v4l2_unplug(VirtualV4l2 *camera);
void virtual_v4l2_plug(VirtualV4l2 *camera, int number);

enum virtual_v4l2_fault { /* holds until set otherwise; for frames that begin from now on */
                          VIRTUAL_V4L2_WELL,
                          VIRTUAL_V4L2_ERROR_FLAG,   /* half of the data, and the error flag */
                          VIRTUAL_V4L2_SHORT,        /* half of the data, and no flag */
                          VIRTUAL_V4L2_FUTURE,       /* stamps are 100 ms ahead */
                          VIRTUAL_V4L2_FROZEN,       /* repeats the previous picture as a new one */
                          VIRTUAL_V4L2_SILENT,       /* no frames */
                          VIRTUAL_V4L2_OTHER_CLOCK,  /* stamps of an unknown clock */
                          VIRTUAL_V4L2_NO_BANDWIDTH, /* refuses to stream for lack of it */
                          VIRTUAL_V4L2_DISOBEYS,     /* controls keep other values than were set */
                          VIRTUAL_V4L2_STREAM_BREAKS, /* taking a frame fails, once */
};
void virtual_v4l2_set_fault(VirtualV4l2 *camera, enum virtual_v4l2_fault fault);

gint64 virtual_v4l2_control(VirtualV4l2 *camera, guint32 id); /* its value; -1: there is none */
int virtual_v4l2_n_exposed(VirtualV4l2 *camera); /* pictures that were made, not only dropped */
