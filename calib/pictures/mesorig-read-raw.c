/* mesorig-read-raw runs LibRaw for other programs; see picture_child.h. */
#include "raw.h"

#include "base/input_file.h"
#include "picture_child.h"

#include <libraw/libraw.h>
#include <math.h>
#include <string.h>

#define CPU_S 120 /* processor time for one picture */

static gboolean fail(const char *path, GError **error, const char *why) {
    g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO, "%s: %s", path, why);
    return FALSE;
}

/* Gives the name of the mosaic. Returns FALSE if the mosaic is not known. */
static gboolean raw_cfa(libraw_data_t *raw, char ret[RAW_CFA]) {
    static const char *const known[] = {"rggb", "bggr", "grbg", "gbrg", NULL};
    if (raw->idata.filters == 0 && raw->idata.colors == 1) {
        g_strlcpy(ret, "mono", RAW_CFA);
        return TRUE;
    }
    /* Filters below 1000 are numbers of patterns larger than 2 × 2 (9: X-Trans). */
    if (raw->idata.filters < 1000 || raw->rawdata.ioparams.fuji_width != 0)
        return FALSE;
    for (int i = 0; i < RAW_CFA - 1; i++)
        ret[i] = g_ascii_tolower(raw->idata.cdesc[libraw_COLOR(raw, i / 2, i % 2) & 3]);
    ret[RAW_CFA - 1] = '\0';
    for (int y = 0; y < 8; y++) /* some old patterns have 4 or 8 rows */
        for (int x = 0; x < 2; x++)
            if (g_ascii_tolower(raw->idata.cdesc[libraw_COLOR(raw, y, x) & 3]) !=
                ret[2 * (y & 1) + x])
                return FALSE;
    return g_strv_contains(known, ret);
}

/* Returns the black level at a place of the visible part. It is the sum of a number for all pixels,
 * a number for each colour filter, and a number from a pattern that repeats. */
static double raw_black(libraw_data_t *raw, int y, int x, gboolean mono) {
    const unsigned *of = raw->color.cblack;
    const unsigned filter = mono ? 0 : (unsigned)libraw_COLOR(raw, y & 1, x & 1) & 3;
    double black = (double)raw->color.black + (double)of[filter];
    if (of[4] > 0 && of[5] > 0 && (guint64)of[4] * of[5] <= LIBRAW_CBLACK_SIZE - 6)
        black += (double)of[6 + ((unsigned)y % of[4]) * of[5] + (unsigned)x % of[5]];
    return black;
}

static gboolean fill(const char *path, libraw_data_t *raw, const char *cfa, struct picture *picture,
                     GError **error) {
    const libraw_image_sizes_t *sizes = &raw->rawdata.sizes;
    const double white = (double)raw->color.maximum;
    const gboolean mono = strcmp(cfa, "mono") == 0;
    const gsize pitch = sizes->raw_pitch / sizeof(ushort);
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const double black = raw_black(raw, y, x, mono);
            const ushort n = raw->rawdata.raw_image[(gsize)(y + sizes->top_margin) * pitch +
                                                    (gsize)x + sizes->left_margin];
            if (!(white > black)) {
                g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                            "%s: the black level of %g is not below the white level of %g; copy "
                            "the file again, or convert it to DNG",
                            path, black, white);
                return FALSE;
            }
            picture->values[(gsize)y * (gsize)picture->width + (gsize)x] =
                (float)(((double)n - black) / (white - black));
        }
    return TRUE;
}

static struct picture *decode(const char *path, libraw_data_t *raw, char *bytes, gsize length,
                              char ret_cfa[RAW_CFA], GError **error) {
    int code = libraw_open_buffer(raw, bytes, length);
    if (code == LIBRAW_SUCCESS &&
        !input_file_check_pixels(path, raw->sizes.raw_width, raw->sizes.raw_height, length, error))
        return NULL;
    if (code == LIBRAW_SUCCESS)
        code = libraw_unpack(raw);
    if (code != LIBRAW_SUCCESS) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                    "%s is not a camera raw picture that can be read (LibRaw: %s); copy the file "
                    "again, or convert it to DNG",
                    path, libraw_strerror(code));
        return NULL;
    }
    const libraw_image_sizes_t *sizes = &raw->rawdata.sizes;
    if (!raw->rawdata.raw_image || !raw_cfa(raw, ret_cfa)) {
        fail(path, error,
             "the picture has no mosaic of 2 × 2 colour filters and is not grey; convert it to a "
             "linear TIFF of 16 bits");
        return NULL;
    }
    if (sizes->width == 0 || sizes->height == 0 ||
        sizes->left_margin + sizes->width > sizes->raw_width ||
        sizes->top_margin + sizes->height > sizes->raw_height ||
        sizes->raw_pitch < sizeof(ushort) * sizes->raw_width) {
        fail(path, error,
             "the visible part is not within the sensor's pixels: the file is damaged, so copy it "
             "again");
        return NULL;
    }
    g_autofree char *sum =
        g_compute_checksum_for_data(G_CHECKSUM_SHA256, (const guchar *)bytes, length);
    g_autoptr(Picture) picture = picture_new(path, sum, sizes->width, sizes->height);
    return fill(path, raw, ret_cfa, picture, error) ? g_steal_pointer(&picture) : NULL;
}

static gboolean read_raw(const struct picture_job *job, GError **error) {
    struct raw_head head = {0};
    libraw_data_t *raw =
        libraw_init(LIBRAW_OPIONS_NO_MEMERR_CALLBACK | LIBRAW_OPIONS_NO_DATAERR_CALLBACK);
    char *bytes = g_try_malloc(job->length + 1);
    if (!raw || !bytes)
        return fail(
            job->path, error,
            "there is too little memory to read the file; close other programs and try again");
    if (!input_file_read_at(job->fd, job->path, bytes, job->length, 0, error))
        return FALSE;
    const struct picture *picture = decode(job->path, raw, bytes, job->length, head.cfa, error);
    if (!picture)
        return FALSE;
    head.width = picture->width;
    head.height = picture->height;
    g_strlcpy(head.sum, picture->checksum, sizeof head.sum);
    return picture_child_write(&head, sizeof head) &&
           picture_child_write(picture->values,
                               sizeof(float) * (gsize)head.width * (gsize)head.height);
}

int main(int argc, char **argv) {
    picture_child_main(argc, argv, CPU_S, read_raw);
}
