/*
 * A V4L2 device node: finding it, opening it, and its properties. The functions call the kernel,
 * which returns at once unless the device is being unplugged. Main loop's thread.
 *
 * Errors are DEVICE_ERROR, and begin with the name of the camera.
 */
#pragma once

#include "formats.h"

#include "drivers/device.h"

#include <linux/videodev2.h>

struct video_node {
    int fd;                    /* -1: not open */
    const char *who;           /* the device that uses it: "camera top"; not owned */
    char *path;                /* "/dev/video0" */
    char *card, *driver, *bus; /* as the node reports them: "HD Webcam", "uvcvideo", "usb-…-1.2" */
    guint32 type; /* V4L2_BUF_TYPE_VIDEO_CAPTURE, or its _MPLANE where it has only that */
};

/* A frame in memory, however the node's type describes it. */
struct video_pix {
    guint32 width, height, fourcc, field;
    guint32 stride; /* of a row, bytes */
    guint32 planes; /* memory planes of one frame: 1 */
    gboolean full_range;
};

/* The node that path or bus names (NULL or empty: any); fails if none fits, or more than one. */
gboolean video_node_open(struct video_node *node, const char *who, const char *path,
                         const char *bus, GError **error);
void video_node_close(struct video_node *node); /* a closed one, or zeroes with fd -1, is allowed */

/* Returns the sorted paths of all nodes that capture video by streaming. */
GPtrArray *video_node_list(void);

/* Calls ioctl(2), again if a signal interrupts it. Returns -1 and sets errno on failure. */
int video_ioctl(const struct video_node *node, unsigned long request, void *arg);

/* Reads the present format. Returns -1 and sets errno on failure. */
int video_node_get_pix(const struct video_node *node, struct video_pix *ret);

/* Sets width, height and fourcc; pix returns the values that the device chose. -1: see errno. */
int video_node_set_pix(const struct video_node *node, struct video_pix *pix);

/* Sets an error from errno; what: "could not start". Returns FALSE always. */
gboolean video_set_error(GError **error, const struct video_node *node, int code, const char *what);

/* An error that names the node: "/dev/video0 cannot …". Returns FALSE always. */
gboolean video_refuse(GError **error, enum device_error code, const struct video_node *node,
                      const char *format, ...) G_GNUC_PRINTF(4, 5);

/* Returns the codes of all formats of the node, also of those that are unusable for measuring. */
GArray *video_node_formats(const struct video_node *node); /* of guint32 */

/* Returns the sizes as text, "640 × 480, 1280 × 720" or a range; g_free(). */
char *video_node_sizes(const struct video_node *node, guint32 fourcc);

/* sysfs folder of the device behind the node, symlinks resolved; NULL if there is none. g_free().
 */
char *video_node_sysfs(const struct video_node *node);
