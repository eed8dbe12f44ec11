#include "inputs.h"

#include "base/data_error.h"
#include "base/error_details.h"

#include <string.h>

/* Commands for the messages of errors. `mesorig resume` takes a frame again if its file is missing
 * or differs from the committed file. */
#define AGAIN  "`mesorig resume` takes the frame again (import an imported session again)"
#define REMEDY "; " AGAIN
#define DELETE ", although the file is as it was committed; delete it, and " AGAIN

void input_clear(struct input *input) {
    g_clear_pointer(&input->path, g_free);
    g_clear_pointer(&input->sha256, g_free);
}

/* Compares the checksum before it decodes anything, because a damaged file must not reach a
 * decoder. */
struct exr_part *input_read(const struct input *input, const char *const *channels,
                            GError **error) {
    g_autoptr(GError) cause = NULL;
    gint64 bytes = 0;
    g_autofree char *sum = exr_sha256(input->path, &bytes, &cause);
    if (!sum) {
        data_error_set(input->path, 0, error, "the session lists this frame, but: %s" REMEDY,
                       cause->message);
        return NULL;
    }
    if (input->sha256 && *input->sha256 && strcmp(sum, input->sha256) != 0) {
        data_error_set(input->path, 0, error,
                       "the file (%" G_GINT64_FORMAT
                       " bytes) is not the file that the session committed: its SHA-256 is %s, but "
                       "the session has %s" REMEDY,
                       bytes, sum, input->sha256);
        return NULL;
    }
    g_autoptr(ExrFile) file = exr_read(input->path, &cause);
    if (!file) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%s" DELETE, error_details_what(cause));
        return NULL;
    }
    const struct exr_part *part = file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    if (!part) {
        data_error_set(input->path, 0, error, "the file has no parts" DELETE);
        return NULL;
    }
    if (part->width != input->width || part->height != input->height) {
        data_error_set(input->path, 0, error,
                       "the frame has %d × %d pixels, but its camera has %d × %d in the session's "
                       "calibration; restore the session from a copy",
                       part->width, part->height, input->width, input->height);
        return NULL;
    }
    for (int i = 0; channels[i]; i++)
        if (!exr_part_plane(part, channels[i])) {
            data_error_set(input->path, 0, error, "part %s lacks channel %s" DELETE, part->name,
                           channels[i]);
            return NULL;
        }
    return g_ptr_array_steal_index(file->parts, 0);
}

const float *input_mosaic(const char *path, struct exr_part *part, const char **ret_cfa,
                          GError **error) {
    if (!exr_get_string(part, "mesorig.cfa", ret_cfa, error)) {
        g_prefix_error(error, "%s: ", path);
        return NULL;
    }
    if (strcmp(*ret_cfa, "rgb") != 0) {
        const float *mosaic = exr_part_plane(part, "Y");
        if (!mosaic)
            data_error_set(path, 0, error, "part %s lacks channel Y" DELETE, part->name);
        return mosaic;
    }
    const float *red = exr_part_plane(part, "R"), *blue = exr_part_plane(part, "B");
    float *mosaic = exr_part_plane(part, "G");
    if (!red || !mosaic || !blue) {
        data_error_set(path, 0, error, "part %s lacks channel %s" DELETE, part->name,
                       !red      ? "R"
                       : !mosaic ? "G"
                                 : "B");
        return NULL;
    }
    for (int y = 0; y < part->height; y++)
        for (int x = y & 1; x < part->width; x += 2) {
            const gsize i = (gsize)y * (gsize)part->width + (gsize)x;
            mosaic[i] = y & 1 ? blue[i] : red[i];
        }
    *ret_cfa = "rggb";
    return mosaic;
}

/* The terminating 0 of the text is hashed as well, so that the texts of a sequence cannot be
 * confused with other texts. */
void input_hash(GChecksum *checksum, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *text = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_checksum_update(checksum, (const guchar *)text, (gssize)strlen(text) + 1);
}
