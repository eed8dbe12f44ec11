#include "pgm.h"

#include "drivers/device.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_HEADER 1024 /* largest number of bytes before the values */
#define MAX_NUMBER 65535

/* Reads a number of the header, after white space and comments. Returns −1 if there is none. */
static int read_number(const guint8 *bytes, gsize n, gsize *at) {
    int number = 0;
    while (*at < n && (g_ascii_isspace(bytes[*at]) || bytes[*at] == '#')) {
        const gboolean comment = bytes[*at] == '#';
        while (comment && *at < n && bytes[*at] != '\n')
            ++*at;
        *at += *at < n;
    }
    if (*at >= n || !g_ascii_isdigit(bytes[*at]))
        return -1;
    for (; *at < n && g_ascii_isdigit(bytes[*at]) && number <= MAX_NUMBER; ++*at)
        number = 10 * number + (bytes[*at] - '0');
    return number;
}

gboolean pgm_parse(const guint8 *bytes, gsize n, int width, int height, int bits, guint16 *pixels,
                   gboolean *ret_complete, GError **error) {
    const gsize n_pixels = (gsize)width * (gsize)height, header = MIN(n, MAX_HEADER);
    gsize at = 2;
    if (n < 2 || memcmp(bytes, "P5", 2) != 0)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "wrote a picture that is not a PGM file (P5)");
    const int w = read_number(bytes, header, &at), h = read_number(bytes, header, &at);
    const int max = read_number(bytes, header, &at);
    if (w < 0 || h < 0 || max < 1 || max > MAX_NUMBER || at >= header ||
        !g_ascii_isspace(bytes[at]))
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "wrote a PGM file with a damaged header");
    if (w != width || h != height)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "wrote a picture of %d × %d pixels, not of %d × %d", w, h, width,
                                height);
    const gsize size = max < 256 ? 1 : 2, there = MIN((n - at - 1) / size, n_pixels);
    const guint8 *data = bytes + at + 1;
    guint16 brightest = 0;
    for (gsize i = 0; i < there; i++) {
        pixels[i] = size == 1 ? data[i] : (guint16)(data[2 * i] << 8 | data[2 * i + 1]);
        brightest = MAX(brightest, pixels[i]);
    }
    memset(pixels + there, 0, (n_pixels - there) * sizeof *pixels);
    *ret_complete = there == n_pixels;
    return brightest < 1u << bits ||
           device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                            "wrote a picture with the value %d, which has more than %d bits",
                            brightest, bits);
}

/* Reads the bytes of an open file, but no more than max. Returns NULL on failure. Free the bytes
 * with g_free(). */
static guint8 *read_bytes(int fd, gsize max, gsize *ret_n) {
    guint8 *bytes = g_try_malloc(MAX(max, 1));
    gsize n = 0;
    gssize part = 1;
    while (bytes && n < max && part != 0) {
        part = read(fd, bytes + n, max - n);
        if (part < 0 && errno != EINTR)
            g_clear_pointer(&bytes, g_free);
        n += (gsize)MAX(part, 0);
    }
    *ret_n = n;
    return bytes;
}

/* Opens a regular file of at most max bytes. Returns −1 with an error for anything else. The check
 * is needed because a program has chosen the name, which may be that of a link, a pipe or a
 * device. */
static int open_picture(const char *path, const char *name, gsize max, gsize *ret_size,
                        GError **error) {
    struct stat about;
    const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL, "wrote no picture “%s”: %s", name,
                         g_strerror(errno));
        return -1;
    }
    if (fstat(fd, &about) < 0 || !S_ISREG(about.st_mode)) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "wrote a picture “%s” that is not a regular file", name);
    } else if ((guint64)about.st_size > max) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "wrote a picture “%s” of %" G_GINT64_FORMAT
                         " bytes, but a picture of this camera has at most %" G_GSIZE_FORMAT,
                         name, (gint64)about.st_size, max);
    } else {
        *ret_size = (gsize)about.st_size;
        return fd;
    }
    close(fd);
    return -1;
}

Frame *pgm_take(const char *folder, const char *name, int width, int height, int bits,
                GError **error) {
    const gsize max = MAX_HEADER + 2 * (gsize)width * (gsize)height;
    gsize size = 0, n = 0;
    gboolean complete = FALSE;
    if (!*name || *name == '.' || strchr(name, '/')) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "named a picture “%s”, which is not the name of a file in its folder",
                         name);
        return NULL;
    }
    g_autofree char *path = g_build_filename(folder, name, NULL);
    const int fd = open_picture(path, name, max, &size, error);
    if (fd < 0)
        return NULL;
    g_autofree guint8 *bytes = read_bytes(fd, size, &n);
    close(fd);
    unlink(path);
    if (!bytes) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "wrote a picture “%s” that cannot be read", name);
        return NULL;
    }
    g_autoptr(Frame) frame = frame_new(width, height);
    if (!pgm_parse(bytes, n, width, height, bits, frame->pixels, &complete, error))
        return NULL;
    frame->bits = bits;
    frame->incomplete = !complete;
    return g_steal_pointer(&frame);
}
