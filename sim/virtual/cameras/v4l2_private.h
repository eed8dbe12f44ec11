/* The state and the functions that the parts of a virtual V4L2 camera share: v4l2.c answers ioctls,
 * v4l2_stream.c delivers frames, and v4l2_pixels.c packs pixels. */
#pragma once

#include "v4l2.h"

#include <linux/videodev2.h>
#include <umockdev.h>

#define MAX_BUFFERS  8
#define MAX_CONTROLS 16

enum buffer_state { BUFFER_IDLE, BUFFER_QUEUED, BUFFER_DONE };

struct virtual_buffer {
    enum buffer_state state;
    guint64 order; /* number that increases with each buffer that is queued or finished */
    guint32 flags, sequence, bytes;
    gint64 stamp_us;
};

struct virtual_control {
    struct v4l2_queryctrl about;
    gint32 value;
};

struct VirtualV4l2 {
    struct virtual_v4l2_config config;
    char *port;
    World *world;
    int world_index;

    UMockdevTestbed *testbed;
    UMockdevIoctlBase *handler;
    char *node;                 /* "/dev/video0" */
    char *sysfs;                /* NULL if the camera is unplugged */
    int fd;                     /* descriptor of the mocked node */
    UMockdevIoctlClient *owner; /* a reference to the client that owns the buffers, or NULL */

    GMutex mutex;
    GCond woken;
    struct virtual_control controls[MAX_CONTROLS];
    int n_controls;
    guint32 fourcc;
    double frame_rate;
    struct virtual_buffer buffers[MAX_BUFFERS];
    int n_buffers;
    guint64 n_ordered;
    enum virtual_v4l2_fault fault;
    int n_exposed;

    gboolean streaming;
    guint stream; /* changes when a stream begins or ends */
    /* Number of stream threads. There may be more than one, because a thread whose stream has ended
     * may still be making its last picture. */
    int n_threads;
    gint64 first_us;   /* time of frame 0; frame n begins n frame intervals later */
    gint64 changed_us; /* time when a control was last set */
    /* Exposure time of frames that begin now. A change of a control affects it one frame later. */
    gint64 exposure_us;
    double gain_db;
    guint16 *pixels; /* the latest picture */
};

/* Call these two functions with the camera locked, in the thread that handles the ioctls of all
 * cameras and USB devices. This thread must not wait, so the functions do not wait. */
void virtual_stream_start(VirtualV4l2 *camera);
void virtual_stream_stop(VirtualV4l2 *camera);
/* Waits until no stream thread uses the camera any more. The mutex must be locked. It is unlocked
 * while the function waits. */
void virtual_stream_wait(VirtualV4l2 *camera);

/* Returns the control with this id, or NULL if the camera lacks it. */
struct virtual_control *virtual_find_control(VirtualV4l2 *camera, guint32 id);
/* Returns the number of bytes that one buffer occupies in the file of the node: whole pages. */
gsize virtual_buffer_room(const VirtualV4l2 *camera);

/* Returns the oldest buffer in a state, or NULL if there is none. */
struct virtual_buffer *virtual_oldest_buffer(VirtualV4l2 *camera, enum buffer_state state);

/* v4l2_pixels.c: the layout of formats in memory. */
gsize virtual_pixels_stride(guint32 fourcc, int width); /* 0 if the format is not available */
gsize virtual_pixels_size(guint32 fourcc, int width, int height);
gboolean virtual_pixels_offered(const struct virtual_v4l2_config *config, guint32 index,
                                guint32 *ret_fourcc);
void virtual_pixels_pack(const struct virtual_v4l2_config *config, guint32 fourcc,
                         const guint16 *pixels, guint8 *to);
