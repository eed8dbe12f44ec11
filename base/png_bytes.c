#include "png_bytes.h"

#include <gio/gio.h>
#include <png.h>

GBytes *png_bytes(const guint8 *rgb, int width, int height, GError **error) {
    png_image image = {.version = PNG_IMAGE_VERSION,
                       .width = (png_uint_32)width,
                       .height = (png_uint_32)height,
                       .format = PNG_FORMAT_RGB,
                       .flags = PNG_IMAGE_FLAG_FAST};
    png_alloc_size_t size = 0;
    if (width > 0 && height > 0 &&
        png_image_write_to_memory(&image, NULL, &size, 0, rgb, 0, NULL)) {
        guint8 *png = g_malloc(size);
        if (png_image_write_to_memory(&image, png, &size, 0, rgb, 0, NULL))
            return g_bytes_new_take(png, size);
        g_free(png);
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                "a picture of %d × %d pixels cannot be written as PNG%s%s", width, height,
                *image.message ? ": " : "", image.message);
    return NULL;
}
