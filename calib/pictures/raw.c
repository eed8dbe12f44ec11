/* A separate program reads the camera raw file. This file starts that program and takes the
 * program's result. */
#include "raw.h"

#include "base/input_file.h"
#include "picture_child.h"

#include <string.h>
#include <unistd.h>

gboolean raw_is(const char *path) {
    static const char *const ends[] = {".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw",
                                       ".arw", ".srf", ".sr2", ".raf", ".orf", ".rw2",
                                       ".pef", ".srw", ".raw", ".rwl", ".iiq", ".3fr",
                                       ".fff", ".mrw", ".x3f", ".erf", ".dcr", ".kdc"};
    g_autofree char *lower = g_ascii_strdown(path, -1);
    for (gsize i = 0; i < G_N_ELEMENTS(ends); i++)
        if (g_str_has_suffix(lower, ends[i]))
            return TRUE;
    return FALSE;
}

struct picture *raw_read(const char *path, char ret_cfa[RAW_CFA], GError **error) {
    struct picture_job job = {.path = path, .program = "mesorig-read-raw"};
    struct raw_head head;
    gsize at = 0;
    job.fd = input_file_open(path, G_MAXINT, &job.length, error);
    if (job.fd < 0)
        return NULL;
    g_autoptr(GBytes) result = picture_child_run(&job, "LibRaw", NULL, NULL, error);
    close(job.fd);
    if (!result)
        return NULL;
    if (picture_child_take(result, &at, &head, sizeof head) && head.width > 0 && head.height > 0 &&
        input_file_check_pixels(path, (guint64)head.width, (guint64)head.height, job.length,
                                NULL)) {
        g_autoptr(Picture) picture = picture_new(path, head.sum, head.width, head.height);
        memcpy(ret_cfa, head.cfa, RAW_CFA);
        if (picture_child_take(result, &at, picture->values,
                               sizeof(float) * (gsize)head.width * (gsize)head.height))
            return g_steal_pointer(&picture);
    }
    g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                "%s: LibRaw returned an incomplete picture; copy the file again, or convert it to "
                "DNG",
                path);
    return NULL;
}

struct picture *raw_read_grey(const char *path, GError **error) {
    char cfa[RAW_CFA];
    g_autoptr(Picture) picture = raw_read(path, cfa, error);
    if (!picture)
        return NULL;
    const gsize n = (gsize)picture->width * (gsize)picture->height;
    g_autofree guint8 *white = g_new(guint8, n);
    for (gsize i = 0; i < n; i++)
        white[i] = picture->values[i] >= 1;
    picture_balance(picture, cfa);
    for (gsize i = 0; i < n; i++)
        if (white[i])
            picture->values[i] = MAX(picture->values[i], 1);
    return g_steal_pointer(&picture);
}
