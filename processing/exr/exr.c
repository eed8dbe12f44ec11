/* The structs of an EXR file in memory: parts with planes of floats and typed attributes. */
#include "exr.h"
#include "exr_private.h"

#include "base/error_details.h"
#include "base/input_file.h"

#include <errno.h>
#include <math.h>
#include <nettle/sha2.h>
#include <string.h>
#include <unistd.h>

GQuark exr_error_quark(void) {
    return error_details_domain("exr_error");
}

static void attribute_free(gpointer data) {
    struct exr_attribute *attribute = data;

    g_free(attribute->name);
    g_free(attribute->string);
    g_free(attribute);
}

GPtrArray *exr_attributes_new(void) {
    return g_ptr_array_new_with_free_func(attribute_free);
}

gboolean exr_is_standard_attribute(const char *name) {
    static const char *const standard[] = {
        "channels",
        "chunkCount",
        "compression",
        "dataWindow",
        "displayWindow",
        "lineOrder",
        "name",
        "pixelAspectRatio",
        "screenWindowCenter",
        "screenWindowWidth",
        "tiles",
        "type",
        "version",
        NULL,
    };

    return g_strv_contains(standard, name);
}

struct exr_part *exr_part_new(const char *name, int width, int height, const char *const *channels,
                              enum exr_type type) {
    struct exr_part *part = g_new0(struct exr_part, 1);

    part->name = g_strdup(name);
    part->width = width;
    part->height = height;
    part->type = type;
    part->channels = g_strdupv((char **)channels);
    part->n_channels = (int)g_strv_length(part->channels);
    part->attributes = exr_attributes_new();
    part->planes = g_new0(float *, part->n_channels + 1);
    for (int c = 0; c < part->n_channels; c++)
        part->planes[c] = g_new0(float, (gsize)width *(gsize)height);
    return part;
}

void exr_part_drop_planes(struct exr_part *part) {
    for (int c = 0; c < part->n_channels; c++)
        g_clear_pointer(&part->planes[c], g_free);
}

void exr_part_free(struct exr_part *part) {
    if (!part)
        return;
    for (int c = 0; part->planes && c < part->n_channels; c++)
        g_free(part->planes[c]);
    g_free(part->planes);
    g_strfreev(part->channels);
    g_clear_pointer(&part->attributes, g_ptr_array_unref);
    g_free(part->name);
    g_free(part);
}

float *exr_part_plane(const struct exr_part *part, const char *channel) {
    for (int c = 0; part->planes && c < part->n_channels; c++)
        if (strcmp(part->channels[c], channel) == 0)
            return part->planes[c];
    return NULL;
}

static struct exr_attribute *find(const struct exr_part *part, const char *name) {
    for (guint i = 0; i < part->attributes->len; i++) {
        struct exr_attribute *attribute = g_ptr_array_index(part->attributes, i);

        if (strcmp(attribute->name, name) == 0)
            return attribute;
    }
    return NULL;
}

/* Returns the attribute with this name, and adds it if it is missing. Clears the attribute's value
 * and sets its type to kind. */
static struct exr_attribute *set(struct exr_part *part, const char *name, enum exr_kind kind) {
    struct exr_attribute *attribute = find(part, name);

    if (!attribute) {
        attribute = g_new0(struct exr_attribute, 1);
        attribute->name = g_strdup(name);
        g_ptr_array_add(part->attributes, attribute);
    }
    g_clear_pointer(&attribute->string, g_free);
    attribute->kind = kind;
    return attribute;
}

gboolean exr_all_finite(const float *values, gsize n) {
    for (gsize i = 0; i < n; i++)
        if (!isfinite(values[i]))
            return FALSE;
    return TRUE;
}

void exr_set_string(struct exr_part *part, const char *name, const char *value) {
    set(part, name, EXR_KIND_STRING)->string = g_strdup(value);
}

void exr_set_int(struct exr_part *part, const char *name, int value) {
    set(part, name, EXR_KIND_INT)->integer = value;
}

void exr_set_double(struct exr_part *part, const char *name, double value) {
    set(part, name, EXR_KIND_DOUBLE)->v[0] = value;
}

void exr_set_v3d(struct exr_part *part, const char *name, double x, double y, double z) {
    struct exr_attribute *attribute = set(part, name, EXR_KIND_V3D);

    attribute->v[0] = x;
    attribute->v[1] = y;
    attribute->v[2] = z;
}

/* Returns an attribute with this name and type. Returns NULL with an error if there is none, or if
 * it has another type. */
static const struct exr_attribute *get(const struct exr_part *part, const char *name,
                                       enum exr_kind kind, const char *type, GError **error) {
    const struct exr_attribute *attribute = find(part, name);

    if (attribute && attribute->kind == kind)
        return attribute;
    g_set_error(error, EXR_ERROR, EXR_ERROR_MISSING,
                attribute
                    ? "part \"%s\" has the attribute \"%s\" with a type other than %s; copy the "
                      "file again or make it again"
                    : "part \"%s\" has no attribute \"%s\" (%s); copy the file again or make it "
                      "again",
                part->name, name, type);
    return NULL;
}

gboolean exr_get_string(const struct exr_part *part, const char *name, const char **ret,
                        GError **error) {
    const struct exr_attribute *attribute = get(part, name, EXR_KIND_STRING, "string", error);

    if (attribute)
        *ret = attribute->string;
    return attribute != NULL;
}

gboolean exr_get_int(const struct exr_part *part, const char *name, int *ret, GError **error) {
    const struct exr_attribute *attribute = get(part, name, EXR_KIND_INT, "int", error);

    if (attribute)
        *ret = attribute->integer;
    return attribute != NULL;
}

gboolean exr_get_double(const struct exr_part *part, const char *name, double *ret,
                        GError **error) {
    const struct exr_attribute *attribute = get(part, name, EXR_KIND_DOUBLE, "double", error);

    if (attribute)
        *ret = attribute->v[0];
    return attribute != NULL;
}

gboolean exr_get_v3d(const struct exr_part *part, const char *name, double ret[3], GError **error) {
    const struct exr_attribute *attribute = get(part, name, EXR_KIND_V3D, "v3d", error);

    if (attribute)
        memcpy(ret, attribute->v, sizeof attribute->v);
    return attribute != NULL;
}

struct exr_file *exr_file_new(void) {
    struct exr_file *file = g_new0(struct exr_file, 1);

    file->parts = g_ptr_array_new_with_free_func((GDestroyNotify)exr_part_free);
    return file;
}

void exr_file_add(struct exr_file *file, struct exr_part *part) {
    g_ptr_array_add(file->parts, part);
}

void exr_file_free(struct exr_file *file) {
    if (!file)
        return;
    g_ptr_array_unref(file->parts);
    g_free(file);
}

struct exr_part *exr_file_part(const struct exr_file *file, const char *name) {
    for (guint i = 0; i < file->parts->len; i++) {
        struct exr_part *part = g_ptr_array_index(file->parts, i);

        if (strcmp(part->name, name) == 0)
            return part;
    }
    return NULL;
}

guint64 exr_plane_bytes(const struct exr_part *part) {
    return (guint64)part->width * (guint64)part->height * (guint64)part->n_channels * sizeof(float);
}

guint64 exr_chunk_bytes(const struct exr_part *part, int lines) {
    return 3 * (guint64)part->width * (guint64)MIN(lines, part->height) *
           (guint64)part->n_channels * sizeof(float);
}

static char *hexadecimal(struct sha256_ctx *hash) {
    guint8 bytes[SHA256_DIGEST_SIZE];
    char *text = g_malloc0(2 * sizeof bytes + 1);
    sha256_digest(hash, sizeof bytes, bytes);
    for (gsize i = 0; i < sizeof bytes; i++)
        g_snprintf(text + 2 * i, 3, "%02x", bytes[i]);
    return text;
}

/* nettle is used because it is faster than GChecksum on processors with instructions for
 * SHA-256. */
char *exr_sha256(const char *path, gint64 *ret_bytes, GError **error) {
    struct sha256_ctx hash;
    g_autofree guint8 *buffer = g_malloc(1 << 18);
    GError *why = NULL;
    gint64 bytes = 0;
    gssize got;
    const int fd = input_file_open(path, G_MAXINT64, NULL, &why);

    if (fd < 0) {
        input_file_propagate(why, EXR_ERROR, EXR_ERROR_IO, EXR_ERROR_FORMAT, error);
        return NULL;
    }
    sha256_init(&hash);
    while ((got = read(fd, buffer, 1 << 18)) > 0 || (got < 0 && errno == EINTR))
        if (got > 0) {
            sha256_update(&hash, (gsize)got, buffer);
            bytes += got;
        }
    if (got < 0)
        g_set_error(error, EXR_ERROR, EXR_ERROR_IO,
                    "%s: cannot be read: %s; check the permissions of the file and the disk", path,
                    g_strerror(errno));
    close(fd);
    if (ret_bytes)
        *ret_bytes = bytes;
    return got == 0 ? hexadecimal(&hash) : NULL;
}

void exr_scratch_swap(struct exr_scratch *scratch, void **first, size_t *first_bytes, void **second,
                      size_t *second_bytes) {
    const struct exr_scratch kept = *scratch;

    *scratch = (struct exr_scratch){{*first, *second}, {*first_bytes, *second_bytes}};
    *first = kept.buffers[0];
    *second = kept.buffers[1];
    *first_bytes = kept.bytes[0];
    *second_bytes = kept.bytes[1];
}

void exr_scratch_clear(struct exr_scratch *scratch) {
    free(scratch->buffers[0]);
    free(scratch->buffers[1]);
    *scratch = (struct exr_scratch){0};
}
