/* What processing takes from the frames of a capture. */
#include "lib/ok.h"
#include "lib/test.h"
#include "session/inputs.h"

#include <glib/gstdio.h>
#include <string.h>

#include "lib/remove_tree.h"

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
TEST(mosaic) {
    static const char *const grey[] = {"Y", NULL}, *const bgr[] = {"B", "G", "R", NULL};
    g_autoptr(GError) error = NULL;
    g_autoptr(ExrPart) mono = new_part(grey, "bggr"), colour = new_part(bgr, "rgb");
    const char *cfa = NULL;
    g_assert_true(input_mosaic("a.exr", mono, &cfa, &error) == mono->planes[0]);
    g_assert_cmpstr(cfa, ==, "bggr");
    const float *mosaic = ok(input_mosaic("a.exr", colour, &cfa, ERR));
    g_assert_cmpstr(cfa, ==, "rggb");
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const char filter = cfa[2 * (i / WIDTH % 2) + i % WIDTH % 2];
        g_assert_cmpfloat((double)mosaic[i], ==, 1000.0 * g_ascii_toupper(filter) + i);
    }
}

TEST(bad) {
    static const char *const grey[] = {"Y", NULL}, *const red[] = {"R", NULL};
    static const struct {
        const char *const *channels;
        const char *cfa, *what;
    } bad[] = {{grey, NULL, "a.exr: "},
               {grey, "rgb", "a.exr: part radiance lacks channel R, although"},
               {red, "mono", "a.exr: part radiance lacks channel Y, although"}};
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(ExrPart) part = new_part(bad[i].channels, bad[i].cfa);
        const char *cfa = NULL;
        g_assert_null(input_mosaic("a.exr", part, &cfa, &error));
        g_assert_nonnull(error);
        g_assert_true(g_str_has_prefix(error->message, bad[i].what));
    }
}

/* The asked file, or an error that names it and says what differs. */
static void read_as(const struct input *input, const char *const *channels, const char *words) {
    g_autoptr(GError) error = NULL;
    g_autoptr(ExrPart) part = input_read(input, channels, &error);
    if (!words) {
        g_assert_no_error(error);
        g_assert_cmpint(part->width, ==, WIDTH);
        return;
    }
    g_assert_null(part);
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, input->path));
    if (!strstr(error->message, words))
        g_error("it does not say “%s”: %s", words, error->message);
}

TEST(read) {
    static const char *const grey[] = {"Y", NULL}, *const red[] = {"R", NULL};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "a.exr", NULL);
    g_autofree char *wrong = g_strnfill(64, '0');
    g_autoptr(ExrFile) file = exr_file_new();
    gint64 bytes = 0;
    exr_file_add(file, new_part(grey, "bggr"));
    struct input input = {.path = path, .shot = 1, .width = WIDTH, .height = HEIGHT};
    read_as(&input, grey, "the session lists this frame, but: ");
    ok(exr_write(path, file, EXR_NONE, FALSE, ERR));
    g_autofree char *sum = ok(exr_sha256(path, &bytes, ERR));
    read_as(&input, grey, NULL); /* not compared */
    input.sha256 = (char *)"";
    read_as(&input, grey, NULL);
    input.sha256 = sum;
    read_as(&input, grey, NULL);
    read_as(&input, red, "lacks channel R, although");
    input.width++;
    read_as(&input, grey, "the frame has 5 × 3 pixels, but its camera has");
    input.width--;
    input.height++;
    read_as(&input, grey, "5 × 3 pixels");
    input.height--;
    input.sha256 = wrong;
    read_as(&input, grey, "is not the file that the session committed");
    input.sha256 = NULL;
    g_assert_true(g_file_set_contents(path, "no picture", -1, NULL));
    read_as(&input, grey, "delete it, and `mesorig resume` takes the frame again");
}
