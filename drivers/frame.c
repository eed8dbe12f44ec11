#include "frame.h"

static const char *const cfa_names[] = {"mono", "rggb", "bggr", "grbg", "gbrg"};

/* The colours of the first two pixels of the first two rows. */
static const enum cfa_colour cfa_colours[][4] = {
    [CFA_MONO] = {CFA_GREEN, CFA_GREEN, CFA_GREEN, CFA_GREEN},
    [CFA_RGGB] = {CFA_RED, CFA_GREEN, CFA_GREEN, CFA_BLUE},
    [CFA_BGGR] = {CFA_BLUE, CFA_GREEN, CFA_GREEN, CFA_RED},
    [CFA_GRBG] = {CFA_GREEN, CFA_RED, CFA_BLUE, CFA_GREEN},
    [CFA_GBRG] = {CFA_GREEN, CFA_BLUE, CFA_RED, CFA_GREEN},
};

Frame *frame_new(int width, int height) {
    g_return_val_if_fail(width > 0 && height > 0 && width <= 65536 && height <= 65536, NULL);
    Frame *frame = g_new0(Frame, 1);
    frame->ref_count = 1;
    frame->width = width;
    frame->height = height;
    frame->pixels = g_new(guint16, (gsize)width * height);
    return frame;
}

Frame *frame_ref(Frame *frame) {
    g_return_val_if_fail(frame, NULL);
    g_atomic_int_inc(&frame->ref_count);
    return frame;
}

void frame_unref(Frame *frame) {
    if (!frame || !g_atomic_int_dec_and_test(&frame->ref_count))
        return;
    g_free(frame->pixels);
    g_free(frame);
}

const char *cfa_name(enum cfa cfa) {
    g_return_val_if_fail((gsize)cfa < G_N_ELEMENTS(cfa_names), "mono");
    return cfa_names[cfa];
}

gboolean cfa_parse(const char *name, enum cfa *ret_cfa) {
    for (gsize i = 0; i < G_N_ELEMENTS(cfa_names); i++) {
        if (g_ascii_strcasecmp(name, cfa_names[i]) == 0) {
            *ret_cfa = (enum cfa)i;
            return TRUE;
        }
    }
    return FALSE;
}

enum cfa_colour cfa_colour_at(enum cfa cfa, int x, int y) {
    g_return_val_if_fail((gsize)cfa < G_N_ELEMENTS(cfa_colours), CFA_GREEN);
    return cfa_colours[cfa][(y & 1) * 2 + (x & 1)];
}
