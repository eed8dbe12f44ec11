/* A glTF 2.0 file (.gltf or .glb) as JSON and bytes. Every length, offset and type is checked. */
#pragma once

#include "scene.h"

#include <json-glib/json-glib.h>

struct gltf {
    const char *path; /* for messages */
    JsonParser *parser;
    JsonObject *root;
    GBytes *binary;     /* binary chunk of a .glb, or NULL */
    GPtrArray *buffers; /* of GBytes; NULL entries are not read yet */
};

/* Sets an error with the path and the text, and returns FALSE. */
gboolean gltf_fail(const struct gltf *gltf, enum scene_error code, GError **error,
                   const char *format, ...) G_GNUC_PRINTF(4, 5);

#define gltf_bad(gltf, error, ...) gltf_fail(gltf, SCENE_ERROR_FORMAT, error, __VA_ARGS__)

/* Opens a file. Call gltf_clear() afterwards, even after an error. */
gboolean gltf_open(struct gltf *gltf, const char *path, GError **error);
void gltf_clear(struct gltf *gltf);

/* Returns element k of an array of the root, such as "meshes". `array` is the name of the array.
 * Returns NULL with an error if there is no such element, or if the element is not an object. */
JsonObject *gltf_item(const struct gltf *gltf, const char *array, gint64 k, GError **error);

/* Returns a member that is a whole number. Returns fallback if there is no such member, or if it is
 * not a whole number. */
gint64 gltf_int(JsonObject *object, const char *name, gint64 fallback);
const char *gltf_string(JsonObject *object, const char *name); /* or NULL */
JsonArray *gltf_array(JsonObject *object, const char *name);   /* or NULL */
JsonObject *gltf_object(JsonObject *object, const char *name); /* or NULL */

/* Returns the bytes of image k. They are in a buffer view, in the URI itself, or in a file below
 * the folder of the glTF file. Returns NULL with an error if they cannot be found. */
GBytes *gltf_image(struct gltf *gltf, gint64 k, GError **error);

/* Returns the numbers of an accessor as an array of float, n_components per element. Integers are
 * converted unchanged, or mapped to 0 … 1 or −1 … 1 if the accessor is normalized. */
GArray *gltf_floats(struct gltf *gltf, gint64 accessor, int n_components, GError **error);
/* Reads an accessor of scalar unsigned integers into an array of guint32. */
GArray *gltf_indices(struct gltf *gltf, gint64 accessor, GError **error);
