/* This file makes grey pictures, and balances colour filter mosaics. */
#include "picture.h"

#include "base/srgb.h"

#include <math.h>
#include <string.h>

G_DEFINE_QUARK(picture_file_error, picture_file_error)

struct picture *picture_new(const char *name, const char *checksum, int width, int height) {
    struct picture *picture = g_new0(struct picture, 1);

    picture->name = g_strdup(name);
    picture->checksum = g_strdup(checksum);
    picture->width = width;
    picture->height = height;
    picture->values = g_new0(float, (gsize)width *(gsize)height);
    return picture;
}

void picture_free(struct picture *picture) {
    if (!picture)
        return;
    g_free(picture->name);
    g_free(picture->checksum);
    g_free(picture->values);
    g_free(picture);
}

void picture_srgb(float ret[256]) {
    for (int i = 0; i < 256; i++)
        ret[i] = (float)srgb_decode(i / 255.0);
}

/* Scales each colour by mean(green) / mean(colour). */
gboolean picture_balance(struct picture *picture, const char *cfa) {
    static const char *const known[] = {"rggb", "bggr", "grbg", "gbrg", NULL};
    double sum[256] = {0}, n[256] = {0};

    if (strcmp(cfa, "mono") == 0)
        return TRUE;
    if (!g_strv_contains(known, cfa))
        return FALSE;
    g_strlcpy(picture->cfa, cfa, sizeof picture->cfa);
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const float value = picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
            const guchar colour = (guchar)cfa[2 * (y & 1) + (x & 1)];
            if (isfinite(value)) {
                sum[colour] += (double)value;
                n[colour]++;
            }
        }
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const guchar colour = (guchar)cfa[2 * (y & 1) + (x & 1)];
            if (sum[colour] > 0)
                picture->values[(gsize)y * (gsize)picture->width + (gsize)x] *=
                    (float)(sum['g'] * n[colour] / (n['g'] * sum[colour]));
        }
    return TRUE;
}
