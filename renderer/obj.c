/* Wavefront OBJ, of which files from anywhere are expected: every number and index is checked. */
#include "scene.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define MAX_CORNERS 4096
#define MAX_VALUE   1e18

struct corner {
    gint32 v, vt, vn; /* vn −1: made from the faces */
};

struct obj {
    const char *name;
    enum scene_up up;
    int line;
    GArray *positions, *normals; /* float[3] */
    GArray *uvs;                 /* float[2] */
    GArray *corners, *polygons;  /* struct corner; the number of corners of each (int) */
    float *smooth;               /* a normal for each position */
};

struct builder {
    GArray *vertices, *indices, *corners, *next;
    gint32 *first; /* vertices made of a position, as chains */
};

static gboolean fail(const struct obj *obj, enum scene_error code, GError **error,
                     const char *format, ...) G_GNUC_PRINTF(4, 5);
static gboolean fail(const struct obj *obj, enum scene_error code, GError **error,
                     const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *text = g_strdup_vprintf(format, list);
    va_end(list);
    g_set_error(error, SCENE_ERROR, code, "%s:%d: %s", obj->name, obj->line, text);
    return FALSE;
}

/* A backslash before the end of a line continues it. */
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

/* To the start of the next line, or the end. */
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
            return fail(obj, SCENE_ERROR_FORMAT, error, "%d finite numbers are expected here", n);
        values[k] = value;
        text = end;
    }
    if (array->len >= SCENE_MAX_VERTICES)
        return fail(obj, SCENE_ERROR_TOO_LARGE, error, "more than %d vertices", SCENE_MAX_VERTICES);
    if (n == 3 && obj->up == SCENE_Y_UP) {
        float y = values[1];
        values[1] = -values[2];
        values[2] = y;
    }
    g_array_append_vals(array, values, 1);
    return TRUE;
}

static gboolean parse_index(struct obj *obj, const char **text, const GArray *array,
                            const char *what, gint32 *ret, GError **error) {
    char *end = (char *)*text;
    gboolean number = g_ascii_isdigit(**text) || (**text == '-' && g_ascii_isdigit((*text)[1]));
    gint64 value = number ? g_ascii_strtoll(*text, &end, 10) : 0;
    if (!number)
        return fail(obj, SCENE_ERROR_FORMAT, error, "an index of %s is expected here", what);
    if (value < 0)
        value += (gint64)array->len + 1;
    if (value < 1 || value > array->len)
        return fail(obj, SCENE_ERROR_FORMAT, error,
                    "there is no %s %" G_GINT64_FORMAT ", %u so far", what, value, array->len);
    *ret = value - 1;
    *text = end;
    return TRUE;
}

/* v/vt or v/vt/vn */
static gboolean parse_corner(struct obj *obj, const char **text, struct corner *ret,
                             GError **error) {
    ret->vn = -1;
    if (!parse_index(obj, text, obj->positions, "position", &ret->v, error))
        return FALSE;
    if (**text != '/' || (*text)[1] == '/')
        return fail(obj, SCENE_ERROR_NO_TEXTURE, error,
                    "this face has no texture coordinates (vt); unwrap the mesh and save it with "
                    "them");
    (*text)++;
    if (!parse_index(obj, text, obj->uvs, "texture coordinate", &ret->vt, error))
        return FALSE;
    if (**text != '/')
        return TRUE;
    (*text)++;
    return parse_index(obj, text, obj->normals, "normal", &ret->vn, error);
}

static gboolean parse_face(struct obj *obj, const char *text, GError **error) {
    int n = 0;
    for (skip_blanks(&text); *text != '\n' && *text != '\0' && *text != '#'; skip_blanks(&text)) {
        struct corner corner;
        if (!parse_corner(obj, &text, &corner, error))
            return FALSE;
        if (strchr(" \t\r\n", *text) == NULL)
            return fail(obj, SCENE_ERROR_FORMAT, error, "v/vt/vn is expected here");
        if (++n > MAX_CORNERS)
            return fail(obj, SCENE_ERROR_TOO_LARGE, error, "more than %d corners", MAX_CORNERS);
        g_array_append_val(obj->corners, corner);
    }
    if (n < 3)
        return fail(obj, SCENE_ERROR_FORMAT, error, "a face has three corners or more, not %d", n);
    if (obj->corners->len > 3 * SCENE_MAX_VERTICES)
        return fail(obj, SCENE_ERROR_TOO_LARGE, error, "more than %d corners of faces",
                    3 * SCENE_MAX_VERTICES);
    g_array_append_val(obj->polygons, n);
    return TRUE;
}

static gboolean keyword(const char *text, const char *word) {
    gsize n = strlen(word);
    return strncmp(text, word, n) == 0 && (text[n] == ' ' || text[n] == '\t');
}

static gboolean parse_line(struct obj *obj, const char *text, GError **error) {
    skip_blanks(&text);
    if (keyword(text, "v"))
        return parse_floats(obj, text + 1, 3, obj->positions, error);
    if (keyword(text, "vn"))
        return parse_floats(obj, text + 2, 3, obj->normals, error);
    if (keyword(text, "vt"))
        return parse_floats(obj, text + 2, 2, obj->uvs, error);
    if (keyword(text, "f"))
        return parse_face(obj, text + 1, error);
    return TRUE;
}

static void cross(const float a[3], const float b[3], float ret[3]) {
    ret[0] = a[1] * b[2] - a[2] * b[1];
    ret[1] = a[2] * b[0] - a[0] * b[2];
    ret[2] = a[0] * b[1] - a[1] * b[0];
}

static float dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static gboolean normalise(float a[3]) {
    float length = sqrtf(dot(a, a));
    if (!(length > 1e-20f) || !isfinite(length))
        return FALSE;
    for (int k = 0; k < 3; k++)
        a[k] /= length;
    return TRUE;
}

static float *position(const struct obj *obj, int v) {
    return (float *)obj->positions->data + 3 * (gsize)v;
}

static const float *uv(const struct obj *obj, int vt) {
    return (const float *)obj->uvs->data + 2 * (gsize)vt;
}

/* Moves the middle of the bounding box to the origin and scales to radius 1, before anything else
 * is computed, so that no later product can overflow. */
static gboolean fit(struct obj *obj, GError **error) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (guint c = 0; c < obj->corners->len; c++)
        for (int k = 0; k < 3; k++) {
            double x = position(obj, g_array_index(obj->corners, struct corner, c).v)[k];
            low[k] = MIN(low[k], x);
            high[k] = MAX(high[k], x);
        }
    double radius = 0.0;
    for (guint c = 0; c < obj->corners->len; c++) {
        const float *p = position(obj, g_array_index(obj->corners, struct corner, c).v);
        double sum = 0.0;
        for (int k = 0; k < 3; k++)
            sum += pow(p[k] - 0.5 * (low[k] + high[k]), 2.0);
        radius = MAX(radius, sqrt(sum));
    }
    if (!(radius > 1e-18))
        return fail(obj, SCENE_ERROR_FORMAT, error, "all positions are the same");
    for (guint v = 0; v < obj->positions->len; v++)
        for (int k = 0; k < 3; k++)
            position(obj, v)[k] = (position(obj, v)[k] - 0.5 * (low[k] + high[k])) / radius;
    return TRUE;
}

/* Twice the polygon's area along its normal. */
static void polygon_normal(const struct obj *obj, const struct corner *corners, int n,
                           float ret[3]) {
    memset(ret, 0, 3 * sizeof(float));
    const float *origin = position(obj, corners[0].v);
    for (int k = 1; k + 1 < n; k++) {
        float a[3], b[3], c[3];
        for (int axis = 0; axis < 3; axis++) {
            a[axis] = position(obj, corners[k].v)[axis] - origin[axis];
            b[axis] = position(obj, corners[k + 1].v)[axis] - origin[axis];
        }
        cross(a, b, c);
        for (int axis = 0; axis < 3; axis++)
            ret[axis] += c[axis];
    }
}

static void smooth_normals(struct obj *obj) {
    obj->smooth = g_new0(float, 3 * (gsize)obj->positions->len);
    const struct corner *corners = (const struct corner *)obj->corners->data;
    for (guint p = 0; p < obj->polygons->len; p++) {
        int n = g_array_index(obj->polygons, int, p);
        float normal[3];
        polygon_normal(obj, corners, n, normal);
        for (int k = 0; k < n; k++)
            for (int axis = 0; axis < 3; axis++)
                obj->smooth[3 * (gsize)corners[k].v + axis] += normal[axis];
        corners += n;
    }
}

static void corner_normal(const struct obj *obj, const struct corner *corner, float ret[3]) {
    if (corner->vn >= 0)
        memcpy(ret, (const float *)obj->normals->data + 3 * (gsize)corner->vn, 3 * sizeof(float));
    else
        memcpy(ret, obj->smooth + 3 * (gsize)corner->v, 3 * sizeof(float));
    if (!normalise(ret))
        memcpy(ret, (float[3]){0.0f, 0.0f, 1.0f}, 3 * sizeof(float));
}

/* Files whose windings disagree with their normals exist; the normals are what the eye sees. */
static gboolean wound_backwards(const struct obj *obj, const struct corner *corners, int n) {
    float face[3], sum = 0.0f;
    polygon_normal(obj, corners, n, face);
    for (int k = 0; k < n; k++) {
        float normal[3];
        corner_normal(obj, &corners[k], normal);
        sum += dot(face, normal);
    }
    return sum < 0.0f;
}

static float uv_area(const struct obj *obj, const struct corner *a, const struct corner *b,
                     const struct corner *c) {
    const float *p = uv(obj, a->vt), *q = uv(obj, b->vt), *r = uv(obj, c->vt);
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

/* Corners that agree in everything, the sense of the texture included, share a vertex. */
static guint32 add_vertex(const struct obj *obj, struct builder *b, const struct corner *corner,
                          float sense) {
    for (gint32 at = b->first[corner->v]; at >= 0; at = g_array_index(b->next, gint32, at)) {
        const struct corner *other = &g_array_index(b->corners, struct corner, at);
        if (other->vt == corner->vt && other->vn == corner->vn &&
            g_array_index(b->vertices, struct vertex, at).tangent[3] == sense)
            return at;
    }
    struct vertex vertex = {.tangent = {0.0f, 0.0f, 0.0f, sense}};
    memcpy(vertex.position, position(obj, corner->v), sizeof vertex.position);
    memcpy(vertex.uv, uv(obj, corner->vt), sizeof vertex.uv);
    corner_normal(obj, corner, vertex.normal);
    gint32 index = b->vertices->len;
    g_array_append_val(b->vertices, vertex);
    g_array_append_val(b->corners, *corner);
    g_array_append_val(b->next, b->first[corner->v]);
    b->first[corner->v] = index;
    return index;
}

/* Of v along the surface, at right angles to the vertex's normal, unit; FALSE: nothing is left. */
static gboolean along_surface(const struct vertex *vertex, const float v[3], float ret[3]) {
    float off = dot(v, vertex->normal);
    for (int k = 0; k < 3; k++)
        ret[k] = v[k] - off * vertex->normal[k];
    return normalise(ret);
}

/* A triangle's angle at its corner v[c], seen along that vertex's normal. */
static float corner_angle(struct vertex *const v[3], int c) {
    float edges[2][3];
    for (int e = 0; e < 2; e++) {
        float edge[3];
        for (int k = 0; k < 3; k++)
            edge[k] = v[(c + 1 + e) % 3]->position[k] - v[c]->position[k];
        if (!along_surface(v[c], edge, edges[e]))
            return 0.0f;
    }
    return acosf(CLAMP(dot(edges[0], edges[1]), -1.0f, 1.0f));
}

/* dP/du of the triangle, added to its corners as MikkTSpace has it, so that normal maps and fibres
 * made elsewhere fit: along the surface of each, weighted by the angle there. */
static void add_tangent(struct builder *b, const guint32 index[3]) {
    struct vertex *v[3];
    for (int k = 0; k < 3; k++)
        v[k] = &g_array_index(b->vertices, struct vertex, index[k]);
    float du1 = v[1]->uv[0] - v[0]->uv[0], dv1 = v[1]->uv[1] - v[0]->uv[1];
    float du2 = v[2]->uv[0] - v[0]->uv[0], dv2 = v[2]->uv[1] - v[0]->uv[1];
    float area = du1 * dv2 - du2 * dv1, tangent[3];
    for (int k = 0; k < 3; k++)
        tangent[k] = (dv2 * (v[1]->position[k] - v[0]->position[k]) -
                      dv1 * (v[2]->position[k] - v[0]->position[k])) *
                     (area < 0.0f ? -1.0f : 1.0f);
    if (area == 0.0f || !normalise(tangent))
        return;
    for (int c = 0; c < 3; c++) {
        float turned[3], angle = corner_angle(v, c);
        for (int k = 0; k < 3 && along_surface(v[c], tangent, turned); k++)
            v[c]->tangent[k] += angle * turned[k];
    }
}

static void add_polygon(const struct obj *obj, struct builder *b, const struct corner *corners,
                        int n) {
    gboolean backwards = wound_backwards(obj, corners, n);
    for (int k = 1; k + 1 < n; k++) {
        const struct corner *c[3] = {&corners[0], &corners[backwards ? k + 1 : k],
                                     &corners[backwards ? k : k + 1]};
        float sense = uv_area(obj, c[0], c[1], c[2]) < 0.0f ? -1.0f : 1.0f;
        guint32 index[3];
        for (int i = 0; i < 3; i++)
            index[i] = add_vertex(obj, b, c[i], sense);
        g_array_append_vals(b->indices, index, 3);
        add_tangent(b, index);
    }
}

static void finish_tangent(struct vertex *vertex) {
    float *t = vertex->tangent, sum[3];
    memcpy(sum, t, sizeof sum);
    if (along_surface(vertex, sum, t))
        return;
    float axis[3] = {0.0f, 0.0f, 0.0f};
    axis[fabsf(vertex->normal[0]) < 0.7f ? 0 : 1] = 1.0f;
    float side[3];
    cross(vertex->normal, axis, side);
    cross(side, vertex->normal, t);
    normalise(t);
}

static struct mesh *build(struct obj *obj) {
    struct builder b = {g_array_new(FALSE, FALSE, sizeof(struct vertex)),
                        g_array_new(FALSE, FALSE, sizeof(guint32)),
                        g_array_new(FALSE, FALSE, sizeof(struct corner)),
                        g_array_new(FALSE, FALSE, sizeof(gint32)),
                        g_new(gint32, obj->positions->len)};
    memset(b.first, 0xff, sizeof(gint32) * (gsize)obj->positions->len);
    const struct corner *corners = (const struct corner *)obj->corners->data;
    for (guint p = 0; p < obj->polygons->len; p++) {
        int n = g_array_index(obj->polygons, int, p);
        add_polygon(obj, &b, corners, n);
        corners += n;
    }
    for (guint k = 0; k < b.vertices->len; k++)
        finish_tangent(&g_array_index(b.vertices, struct vertex, k));
    struct mesh *mesh = g_new0(struct mesh, 1);
    mesh->name = g_strdup(obj->name);
    mesh->n_vertices = b.vertices->len;
    mesh->n_indices = b.indices->len;
    mesh->vertices = (struct vertex *)g_array_free(b.vertices, FALSE);
    mesh->indices = (guint32 *)g_array_free(b.indices, FALSE);
    mesh->radius = 1.0f;
    mesh->tiles_u = mesh->tiles_v = 1.0;
    g_array_unref(b.corners);
    g_array_unref(b.next);
    g_free(b.first);
    return mesh;
}

static gboolean parse(struct obj *obj, const char *text, GError **error) {
    obj->line = 1;
    for (const char *line = text; *line != '\0'; line = next_line(obj, line))
        if (!parse_line(obj, line, error))
            return FALSE;
    if (obj->polygons->len == 0)
        return fail(obj, SCENE_ERROR_FORMAT, error, "there is no face in this file");
    return TRUE;
}

struct mesh *scene_parse_obj(const char *name, const char *text, enum scene_up up, GError **error) {
    struct obj obj = {.name = name, .up = up};
    g_autoptr(GArray) positions = obj.positions = g_array_new(FALSE, FALSE, 3 * sizeof(float));
    g_autoptr(GArray) normals = obj.normals = g_array_new(FALSE, FALSE, 3 * sizeof(float));
    g_autoptr(GArray) uvs = obj.uvs = g_array_new(FALSE, FALSE, 2 * sizeof(float));
    g_autoptr(GArray) corners = obj.corners = g_array_new(FALSE, FALSE, sizeof(struct corner));
    g_autoptr(GArray) polygons = obj.polygons = g_array_new(FALSE, FALSE, sizeof(int));
    if (!parse(&obj, text, error) || !fit(&obj, error))
        return NULL;
    smooth_normals(&obj);
    struct mesh *mesh = build(&obj);
    g_free(obj.smooth);
    return mesh;
}

struct mesh *scene_read_obj(const char *path, enum scene_up up, GError **error) {
    GStatBuf info;
    if (g_stat(path, &info) == 0 && info.st_size > SCENE_MAX_FILE) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_TOO_LARGE, "%s is larger than %d MiB", path,
                    SCENE_MAX_FILE >> 20);
        return NULL;
    }
    g_autofree char *text = NULL;
    gsize length;
    g_autoptr(GError) local = NULL;
    if (!g_file_get_contents(path, &text, &length, &local)) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_IO, "%s: cannot be read: %s", path,
                    local->message);
        return NULL;
    }
    if (strlen(text) != length) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_FORMAT, "%s is not a text file", path);
        return NULL;
    }
    return scene_parse_obj(path, text, up, error);
}
