#include "picture_values.h"

#include <math.h>

#define DARK_PART (1.0 / 256)

struct picture_values picture_values(const Frame *frame) {
    struct picture_values ret = {0};
    const gsize n = (gsize)frame->width * (gsize)frame->height;
    const int top = (1 << frame->bits) - 1, step = frame->cfa == CFA_MONO ? 1 : 2;
    const double dark_dn = frame->black_level + DARK_PART * (top - frame->black_level);
    gsize saturated = 0, dark = 0, inner = 0, above = 0;
    g_autofree guint *counts = g_new0(guint, (gsize)top + 1);
    double sum = 0, squares = 0;
    for (gsize i = 0; i < n; i++) {
        const int dn = MIN(frame->pixels[i], top);
        sum += dn;
        counts[dn]++;
        ret.max_dn = MAX(ret.max_dn, dn);
        saturated += dn == top;
        dark += dn < dark_dn;
        ret.bins[(gsize)dn * PICTURE_BINS / ((gsize)top + 1)]++;
    }
    for (int y = step; y < frame->height - step; y++)
        for (int x = step; x < frame->width - step; x++) {
            const guint16 *at = &frame->pixels[(gsize)y * (gsize)frame->width + (gsize)x];
            const gssize row = (gssize)step * frame->width;
            const double laplacian = 4.0 * at[0] - at[-step] - at[step] - at[-row] - at[row];
            squares += laplacian * laplacian;
            inner++;
        }
    for (ret.high_dn = top; ret.high_dn > 0; ret.high_dn--)
        if ((above += counts[(int)ret.high_dn]) * 100 > n)
            break;
    ret.mean_dn = sum / (double)n;
    ret.saturated = (double)saturated / (double)n;
    ret.dark = (double)dark / (double)n;
    const double light = ret.mean_dn - frame->black_level;
    ret.focus = inner > 0 && light > DARK_PART * top ? sqrt(squares / (double)inner) / light : 0;
    return ret;
}
