#include "painted.h"

static guint16 painted_value(int x, int y) {
    return (guint16)((x * 61 + y * 1117 + x * y) & 0xfff);
}

void painted_paint(const struct virtual_exposure *exposure, gpointer data, guint16 *pixels) {
    for (int y = 0; y < PAINTED_HEIGHT; y++)
        for (int x = 0; x < PAINTED_WIDTH; x++)
            *pixels++ = painted_value(x, y);
}

void painted_assert(const Frame *frame, int x0, int y0, int shift) {
    for (int y = 0; y < frame->height; y++)
        for (int x = 0; x < frame->width; x++) {
            guint value = painted_value(x + x0, y + y0);
            guint expected =
                frame->bits > 12 ? value << (frame->bits - 12) : value >> (12 - frame->bits);
            g_assert_cmpuint(frame->pixels[y * frame->width + x], ==,
                             MIN(expected + (guint)shift, (1u << frame->bits) - 1));
        }
}
