/*
 * A V4L2 device node: finding it, opening it, and reading its properties. The functions belong to
 * the main loop's thread. They call the kernel, which returns immediately, except while the device
 * is being unplugged.
 *
 * Errors are DEVICE_ERROR, and begin with the name of the camera.
 */
#pragma once

#include "formats.h"

#include "drivers/device.h"

#include <linux/videodev2.h>

struct video_node {
    int fd;          /* -1 if the node is not open */
    const char *who; /* the device that uses the node, such as "camera top"; not owned */
    char *path;      /* "/dev/video0" */
    /* The strings that the node reports: "HD Webcam", "uvcvideo", "usb-…-1.2". */
    char *card, *driver, *bus;
    /* V4L2_BUF_TYPE_VIDEO_CAPTURE, or V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE if the node has only that
     * type */
    guint32 type;
};

/* The format of a frame in memory, for both types of node. */
struct video_pix {
    guint32 width, height, fourcc, field;
    guint32 stride; /* number of bytes from the start of a row to the start of the next one */
    guint32 planes; /* number of memory planes of one frame; only 1 is supported */
    gboolean full_range;
};

/* Opens the node at `path`. If `path` is NULL or empty, opens the node whose bus name (struct
 * video_node) is `bus`. If both are NULL or empty, any node matches. Fails if no node matches, or
 * if more than one does. The node is then not open. `who` is not copied and must stay valid. */
gboolean video_node_open(struct video_node *node, const char *who, const char *path,
                         const char *bus, GError **error);
/* Closes the node. A node that is not open, or that is zeroed with fd -1, is allowed. */
void video_node_close(struct video_node *node);

/* Returns the sorted paths of all nodes that capture video by streaming, and of those that cannot
 * be opened. Free the array with g_ptr_array_unref(). */
GPtrArray *video_node_list(void);

/* Calls ioctl(2), and calls it again if a signal interrupts it. Returns -1 and sets errno on
 * failure. */
int video_ioctl(const struct video_node *node, unsigned long request, void *arg);

/* Reads the present format. Returns 0, or -1 with errno set. */
int video_node_get_pix(const struct video_node *node, struct video_pix *ret);

/* Sets width, height and fourcc. The device may choose other values, which are returned in pix.
 * Returns -1 and sets errno on failure. */
int video_node_set_pix(const struct video_node *node, struct video_pix *pix);

/* Sets an error from `code`, a value of errno. `what` says what failed, such as "could not start".
 * Always returns FALSE. */
gboolean video_set_error(GError **error, const struct video_node *node, int code, const char *what);

/* Sets an error that names the node: "/dev/video0 cannot …". Always returns FALSE. */
gboolean video_refuse(GError **error, enum device_error code, const struct video_node *node,
                      const char *format, ...) G_GNUC_PRINTF(4, 5);

/* Returns the codes of all formats of the node, including those that cannot be used for measuring.
 * Free the array with g_array_unref(). */
GArray *video_node_formats(const struct video_node *node); /* an array of guint32 */

/* Returns the sizes of a format as text, "640 × 480, 1280 × 720" or a range. Free it with
 * g_free(). */
char *video_node_sizes(const struct video_node *node, guint32 fourcc);

/* Returns the sysfs folder of the device behind the node, with symlinks resolved. Returns NULL if
 * there is none. Free it with g_free(). */
char *video_node_sysfs(const struct video_node *node);
