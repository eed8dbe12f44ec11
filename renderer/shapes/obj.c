/* Wavefront OBJ. A file may come from an untrusted source, so every number and index is checked. */
#include "soup.h"

#include "base/input_file.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#define MAX_CORNERS 4096
#define MAX_VALUE   1e18

struct obj {
    const char *name;
    enum scene_up up;
    int line;
    struct soup soup;
};

G_GNUC_PRINTF(4, 5)
static gboolean fail(const struct obj *obj, enum scene_error code, GError **error,
                     const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *text = g_strdup_vprintf(format, list);
    va_end(list);
    g_set_error(error, SCENE_ERROR, code, "%s:%d: %s", obj->name, obj->line, text);
    return FALSE;
}

#define obj_bad(obj, error, ...) fail(obj, SCENE_ERROR_FORMAT, error, __VA_ARGS__)

/* Skips blanks. A backslash before the end of a line continues the line. */
static void skip_blanks(const char **text) {
    for (;;) {
        if (**text == ' ' || **text == '\t' || **text == '\r')
            (*text)++;
        else if (**text == '\\' && ((*text)[1] == '\n' || strncmp(*text + 1, "\r\n", 2) == 0))
            *text += (*text)[1] == '\n' ? 2 : 3;
        else
            return;
    }
}

/* Returns the start of the next line, or the end of the text, and counts lines in obj->line. A
 * backslash before the end of a line continues the line. */
static const char *next_line(struct obj *obj, const char *start) {
    for (const char *at = start;; at++) {
        at += strcspn(at, "\n");
        if (*at == '\0')
            return at;
        obj->line++;
        const char *last = at > start && at[-1] == '\r' ? at - 1 : at;
        if (last == start || last[-1] != '\\')
            return at + 1;
    }
}

static gboolean parse_floats(struct obj *obj, const char *text, int n, GArray *array,
                             GError **error) {
    float values[3];
    for (int k = 0; k < n; k++) {
        char *end = (char *)text;
        skip_blanks(&text);
        double value = *text == '\n' || *text == '\0' ? NAN : g_ascii_strtod(text, &end);
        if (!(fabs(value) <= MAX_VALUE) || end == text)
            return obj_bad(obj, error,
                           "%d numbers within ±%g are expected here; export the mesh again", n,
                           MAX_VALUE);
        values[k] = value;
        text = end;
    }
    if (array->len >= SCENE_MAX_VERTICES)
        return fail(obj, SCENE_ERROR_TOO_LARGE, error,
                    "there are more than %d lines of this kind; simplify the mesh",
                    SCENE_MAX_VERTICES);
    if (n == 3 && obj->up == SCENE_Y_UP)
        soup_y_to_z_up(values);
    g_array_append_vals(array, values, 1);
    return TRUE;
}

static gboolean parse_index(struct obj *obj, const char **text, const GArray *array,
                            const char *what, gint32 *ret, GError **error) {
    char *end = (char *)*text;
    gboolean number = g_ascii_isdigit(**text) || (**text == '-' && g_ascii_isdigit((*text)[1]));
    gint64 value = number ? g_ascii_strtoll(*text, &end, 10) : 0;
    if (!number)
        return obj_bad(obj, error, "an index of %s is expected here; export the mesh again", what);
    const gint64 given = value; /* a negative index counts back from this line */
    if (value < 0)
        value += (gint64)array->len + 1;
    if (value < 1 || value > array->len)
        return obj_bad(obj, error,
                       "there is no %s %" G_GINT64_FORMAT
                       ", because the lines before this one have %u; export the mesh again",
                       what, given, array->len);
    *ret = value - 1;
    *text = end;
    return TRUE;
}

/* Parses v/vt or v/vt/vn. */
static gboolean parse_corner(struct obj *obj, const char **text, struct soup_corner *ret,
                             GError **error) {
    ret->vn = -1;
    if (!parse_index(obj, text, obj->soup.positions, "position", &ret->v, error))
        return FALSE;
    if (**text != '/' || (*text)[1] == '/')
        return fail(obj, SCENE_ERROR_NO_TEXTURE, error,
                    "this face has no texture coordinates (vt); unwrap the mesh and save it again");
    (*text)++;
    if (!parse_index(obj, text, obj->soup.uvs, "texture coordinate", &ret->vt, error))
        return FALSE;
    if (**text != '/')
        return TRUE;
    (*text)++;
    return parse_index(obj, text, obj->soup.normals, "normal", &ret->vn, error);
}

static gboolean parse_face(struct obj *obj, const char *text, GError **error) {
    int n = 0;
    for (skip_blanks(&text); *text != '\n' && *text != '\0' && *text != '#'; skip_blanks(&text)) {
        struct soup_corner corner;
        if (!parse_corner(obj, &text, &corner, error))
            return FALSE;
        if (strchr(" \t\r\n", *text) == NULL)
            return obj_bad(obj, error, "v/vt/vn is expected here; export the mesh again");
        if (++n > MAX_CORNERS)
            return fail(obj, SCENE_ERROR_TOO_LARGE, error,
                        "this face has more than %d corners; triangulate the mesh", MAX_CORNERS);
        g_array_append_val(obj->soup.corners, corner);
    }
    if (n < 3)
        return obj_bad(
            obj, error,
            "a face needs at least three corners, but this one has %d; export the mesh again", n);
    if (obj->soup.corners->len > SOUP_MAX_CORNERS)
        return fail(obj, SCENE_ERROR_TOO_LARGE, error,
                    "the faces have more than %d corners in all; simplify the mesh",
                    SOUP_MAX_CORNERS);
    g_array_append_val(obj->soup.polygons, n);
    return TRUE;
}

static gboolean parse_line(struct obj *obj, const char *text, GError **error) {
    skip_blanks(&text);
    const gsize n = strcspn(text, " \t\r\n");
    if (text[n] != ' ' && text[n] != '\t')
        return TRUE;
    if (n == 1 && text[0] == 'v')
        return parse_floats(obj, text + n, 3, obj->soup.positions, error);
    if (n == 2 && strncmp(text, "vn", n) == 0)
        return parse_floats(obj, text + n, 3, obj->soup.normals, error);
    if (n == 2 && strncmp(text, "vt", n) == 0)
        return parse_floats(obj, text + n, 2, obj->soup.uvs, error);
    if (n == 1 && text[0] == 'f')
        return parse_face(obj, text + n, error);
    return TRUE;
}

struct mesh *scene_parse_obj(const char *name, const char *text, enum scene_up up, GError **error) {
    struct obj obj = {.name = name, .up = up, .line = 1};
    struct mesh *mesh = NULL;
    gboolean good = TRUE;
    soup_init(&obj.soup);
    for (const char *line = text; good && *line != '\0'; line = next_line(&obj, line))
        good = parse_line(&obj, line, error);
    if (good && obj.soup.polygons->len == 0)
        good = obj_bad(&obj, error, "there is no face in this file; export a mesh with faces");
    g_autofree char *where = g_strdup_printf("%s:%d", name, obj.line);
    if (good)
        mesh = soup_mesh(&obj.soup, name, where, TRUE, error);
    soup_clear(&obj.soup);
    return mesh;
}

struct mesh *scene_read_obj(const char *path, enum scene_up up, GError **error) {
    GError *local = NULL;
    g_autofree char *text = input_file_read_text(path, SCENE_MAX_FILE, &local);
    if (text == NULL) {
        input_file_propagate(local, SCENE_ERROR, SCENE_ERROR_IO, SCENE_ERROR_FORMAT, error);
        return NULL;
    }
    return scene_parse_obj(path, text, up, error);
}
