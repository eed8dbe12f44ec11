/*
 * Virtual cameras behind umockdev's /dev/video. They answer the kernel's V4L2 ioctls and expose
 * continuously in real time, like UVC cameras. Their pictures come from the simulated world or from
 * a test. A process sees them only after testbed_enter().
 *
 * A camera has a separate thread while it streams. Only the main thread may call the functions of
 * this header.
 */
#pragma once

#include "world/world.h"

typedef struct VirtualV4l2 VirtualV4l2;

/* Computes the picture of the sensor. Called in the camera's thread at the end of an exposure.
 * number is the number of the frame since the stream began. ret_pixels receives height × width
 * values below 2^bits. */
typedef void (*VirtualV4l2Expose)(gpointer user, gint64 start_us, gint64 exposure_us,
                                  double gain_db, guint64 number, guint16 *ret_pixels);

/* Which moment the time stamps of frames mark, and which flag the frames have. */
enum virtual_v4l2_stamp {
    VIRTUAL_V4L2_START, /* start of the exposure, with the flag SOE (start of exposure) */
    /* time of the first data; the flag is SOE nevertheless, as with uvcvideo */
    VIRTUAL_V4L2_FIRST_DATA,
    VIRTUAL_V4L2_END, /* end of the data, with the flag EOF (end of frame) */
};

enum { /* controls that the camera lacks */
       VIRTUAL_V4L2_NO_EXPOSURE = 1,
       VIRTUAL_V4L2_NO_GAIN = 2,
       VIRTUAL_V4L2_NO_WHITE_BALANCE = 4,
};

struct virtual_v4l2_config { /* members that are 0 or NULL have the defaults given here */
    int number;              /* number of the node: 0 for /dev/video0 */
    /* ports on USB: the bus, and then the port at each hub; NULL means "2-1" */
    const char *port;
    double speed_mbit_s; /* speed of all links to the camera; 0 means 480 */
    int width, height;   /* size of all pictures; 0 means 64 × 48 */
    enum cfa cfa;
    int bits; /* bits of the sensor; 0 means 12 */
    /* Initial number of frames per second. 0 means 100. Programs can set any rate from 1 to
     * 1000. */
    double frame_rate;
    enum virtual_v4l2_stamp stamp;
    guint lacks;              /* controls that the camera lacks, an OR of VIRTUAL_V4L2_NO_… */
    gboolean odd_gamma;       /* gamma is from 0 to 31, not from 100 to 500 as in UVC */
    gboolean only_compressed; /* the camera offers only compressed formats */
    /* Number of memory planes of a frame in the multi-planar interface. 0: the camera has the
     * single-planar interface. */
    int planes;
    VirtualV4l2Expose expose; /* NULL means a ramp with noise that depends on the exposure */
    gpointer user;
};

/* Makes a camera. Strings are copied. */
VirtualV4l2 *virtual_v4l2_new(const struct virtual_v4l2_config *config);

/* Makes a camera that delivers the pictures of a camera of the simulated world, which has the name
 * `camera`. Size, bits and colour filter array are also those of the world's camera. Returns NULL
 * with an error if the world has no such camera. */
VirtualV4l2 *virtual_v4l2_new_world(const struct virtual_v4l2_config *config, World *world,
                                    const char *camera, GError **error);
void virtual_v4l2_free(VirtualV4l2 *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualV4l2, virtual_v4l2_free)

/* Unplug the camera, and plug it in again as /dev/videoNUMBER. */
void virtual_v4l2_unplug(VirtualV4l2 *camera);
void virtual_v4l2_plug(VirtualV4l2 *camera, int number);

enum virtual_v4l2_fault { /* fault of all frames from now on, until another fault is set */
                          VIRTUAL_V4L2_WELL,
                          VIRTUAL_V4L2_ERROR_FLAG,  /* half of the data, and the error flag */
                          VIRTUAL_V4L2_SHORT,       /* half of the data, and no flag */
                          VIRTUAL_V4L2_FUTURE,      /* time stamps are 100 ms in the future */
                          VIRTUAL_V4L2_FROZEN,      /* repeats the previous picture as a new one */
                          VIRTUAL_V4L2_SILENT,      /* no frames */
                          VIRTUAL_V4L2_OTHER_CLOCK, /* time stamps of an unknown clock */
                          /* refuses to stream because the bus has too little bandwidth */
                          VIRTUAL_V4L2_NO_BANDWIDTH,
                          /* controls take another value than the value that was set */
                          VIRTUAL_V4L2_DISOBEYS,
                          VIRTUAL_V4L2_STREAM_BREAKS, /* dequeuing a frame fails once */
};
void virtual_v4l2_set_fault(VirtualV4l2 *camera, enum virtual_v4l2_fault fault);

/* Returns the value of a control; -1 if it does not exist. */
gint64 virtual_v4l2_control(VirtualV4l2 *camera, guint32 id);
/* Returns the number of pictures that were made. A frame gives no picture if no buffer is queued
 * when its exposure ends, or if the fault SILENT is set. */
int virtual_v4l2_n_exposed(VirtualV4l2 *camera);
