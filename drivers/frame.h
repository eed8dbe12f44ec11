/* What a camera delivers for one exposure, as it came off the sensor. Counted references,
 * thread-safe; not changed after it was handed out. */
#pragma once

#include <glib.h>

enum cfa { /* colour filter array: the first two pixels of the first two rows */
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
    guint64 shot; /* as given to camera_trigger() */
    guint64 id;   /* counter of the device, increasing; wraps only if the driver says so */
    gint64 exposure_start_us, exposure_end_us; /* on the Clock's scale */
    gint64 exposure_us;                        /* as configured */
    int width, height;
    enum cfa cfa;
    int bits;            /* of the ADC: values are 0 .. 2^bits - 1 */
    double black_level;  /* in those units, nominal */
    gboolean incomplete; /* some of its data was lost in transmission */
    guint16 *pixels;     /* height rows of width, top row first, owned */
};

Frame *frame_new(int width, int height); /* pixels allocated, not set */
Frame *frame_ref(Frame *frame);
void frame_unref(Frame *frame); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Frame, frame_unref)

const char *cfa_name(enum cfa cfa); /* "mono", "rggb", … */
gboolean cfa_parse(const char *name, enum cfa *ret_cfa);
enum cfa_colour cfa_colour_at(enum cfa cfa, int x, int y); /* CFA_GREEN for mono */
