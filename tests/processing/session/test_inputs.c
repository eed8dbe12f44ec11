/* What processing takes from the frames of a capture. */
#include "session/inputs.h"

#include <glib/gstdio.h>
#include <string.h>

#define WIDTH  5
#define HEIGHT 3

static struct exr_part *new_part(const char *const *channels, const char *cfa) {
    struct exr_part *part = exr_part_new("radiance", WIDTH, HEIGHT, channels, EXR_FLOAT);
    for (int c = 0; c < part->n_channels; c++)
        for (int i = 0; i < WIDTH * HEIGHT; i++)
            part->planes[c][i] = (float)(1000 * part->channels[c][0] + i);
    if (cfa)
        exr_set_string(part, "mesorig.cfa", cfa);
    return part;
}

/* Of a picture in colour a pixel keeps the value that it has behind the filter, at its own place.
 */
static void test_mosaic(void) {
    static const char *const grey[] = {"Y", NULL}, *const bgr[] = {"B", "G", "R", NULL};
    g_autoptr(GError) error = NULL;
    g_autoptr(ExrPart) mono = new_part(grey, "bggr"), colour = new_part(bgr, "rgb");
    const char *cfa = NULL;
    g_assert_true(input_mosaic("a.exr", mono, &cfa, &error) == mono->planes[0]);
    g_assert_cmpstr(cfa, ==, "bggr");
    const float *mosaic = input_mosaic("a.exr", colour, &cfa, &error);
    g_assert_no_error(error);
    g_assert_cmpstr(cfa, ==, "rggb");
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const char filter = cfa[2 * (i / WIDTH % 2) + i % WIDTH % 2];
        g_assert_cmpfloat((double)mosaic[i], ==, 1000.0 * g_ascii_toupper(filter) + i);
    }
}

static void test_bad(void) {
    static const char *const grey[] = {"Y", NULL}, *const red[] = {"R", NULL};
    static const struct {
        const char *const *channels;
        const char *cfa, *what;
    } bad[] = {{grey, NULL, "a.exr: "},
               {grey, "rgb", "a.exr: part radiance lacks one of the channels R, G and B"},
               {red, "mono", "a.exr: part radiance has no channel Y"}};
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(ExrPart) part = new_part(bad[i].channels, bad[i].cfa);
        const char *cfa = NULL;
        g_assert_null(input_mosaic("a.exr", part, &cfa, &error));
        g_assert_nonnull(error);
        g_assert_true(g_str_has_prefix(error->message, bad[i].what));
    }
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/inputs/mosaic", test_mosaic);
    g_test_add_func("/inputs/bad", test_bad);
    return g_test_run();
}
