/* The image that a camera delivers for one exposure, as the sensor gave it. Frames are
 * reference-counted, and the counting is thread-safe. A frame must not be changed after its camera
 * has delivered it. */
#pragma once

#include <glib.h>

enum cfa { /* colour filter array, named after the first two pixels of the first two rows */
           CFA_MONO,
           CFA_RGGB,
           CFA_BGGR,
           CFA_GRBG,
           CFA_GBRG,
};

enum cfa_colour { CFA_RED, CFA_GREEN, CFA_BLUE };

typedef struct Frame Frame;

struct Frame {
    gint ref_count;
    guint64 shot; /* number that was given to camera_trigger() */
    /* Number of the frame. It increases from frame to frame until the camera is armed again. */
    guint64 id;
    gint64 exposure_start_us, exposure_end_us; /* on the Clock's scale */
    gint64 exposure_us;                        /* exposure time that was set */
    int width, height;
    enum cfa cfa;
    int bits;            /* bits of the converter: values are 0 .. 2^bits - 1 */
    double black_level;  /* nominal black level, in the units of the pixels */
    gboolean incomplete; /* some of its data was lost in transmission */
    guint16 *pixels;     /* height rows of width, top row first, owned */
};

Frame *frame_new(int width, int height); /* the pixels are allocated but not initialized */
Frame *frame_ref(Frame *frame);
void frame_unref(Frame *frame); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Frame, frame_unref)

const char *cfa_name(enum cfa cfa); /* "mono", "rggb", … */
gboolean cfa_parse(const char *name, enum cfa *ret_cfa);
enum cfa_colour cfa_colour_at(enum cfa cfa, int x, int y); /* returns CFA_GREEN for CFA_MONO */
