/*
 * The surface is found between samples of g, and each sample is opaque or free. Samples are the
 * centres of the voxels and further ones around the shell. Those of the layer below the shell, the
 * base, are opaque. All other samples around the shell are free, so that the mesh is closed.
 *
 * Eight neighbouring samples are the corners of a cell. A cell that has free and opaque corners
 * gets a vertex, at the mean of the points where g crosses the level on its edges. Two neighbouring
 * samples, of which one is free and the other opaque, have an edge between them that belongs to
 * four cells. The vertices of these cells make a quad.
 */
#include "mdf_mesh.h"

#include "base/vec.h"
#include "shell_ray.h"

#include <math.h>
#include <stdlib.h>

#define DEG (G_PI / 180.0)

struct net {
    const struct mdf_shell *shell;
    int n[3];       /* number of samples along u, v and the depth, with the base */
    double size[3]; /* size of the solid in mm; the solid extends one layer below the shell */
    double level;
    guint32 *vertex; /* for each cell, the index of its vertex plus 1; 0 if the cell has none */
    GArray *vertices, *indices;
};

/* Returns g − level at a sample. */
static double sample(const struct net *net, const int at[3]) {
    for (int c = 0; c < 3; c++)
        if (at[c] < 0 || at[c] >= net->n[c])
            return -net->level;
    if (at[2] == net->shell->depth)
        return 1.0 - net->level;
    const gsize k = ((gsize)at[2] * net->n[1] + at[1]) * net->n[0] + at[0];
    return net->shell->values[k] / 255.0 - net->level;
}

/* Returns the position of a sample along an axis, in mm. A sample outside of the solid gets the
 * position of the nearest side. A sample of the base has the depth of the shell. */
static double position(const struct net *net, int axis, int at) {
    const struct mdf_shell *s = net->shell;
    if (axis == 2 && at == s->depth)
        return s->depth_mm;
    return CLAMP((at + 0.5) / net->n[axis] * net->size[axis], 0.0, net->size[axis]);
}

static gsize cell_index(const struct net *net, const int cell[3]) {
    return ((gsize)(cell[2] + 1) * (net->n[1] + 1) + (cell[1] + 1)) * (net->n[0] + 1) +
           (cell[0] + 1);
}

/* Adds to sum the point where g crosses the level on an edge of a cell. Returns FALSE if g does not
 * cross the level there. */
static gboolean add_crossing(const struct net *net, const int from[3], int axis, double sum[3]) {
    int to[3] = {from[0], from[1], from[2]};
    to[axis]++;
    const double a = sample(net, from), b = sample(net, to);
    if ((a >= 0.0) == (b >= 0.0))
        return FALSE;
    /* an edge that leaves the solid crosses the surface at the side of the solid */
    const gboolean outside = from[axis] < 0 || to[axis] >= net->n[axis];
    const double share = outside ? (from[axis] < 0 ? 0.0 : 1.0) : a / (a - b);
    for (int c = 0; c < 3; c++)
        sum[c] += position(net, c, from[c]);
    sum[axis] += share * (position(net, axis, to[axis]) - position(net, axis, from[axis]));
    return TRUE;
}

/* Makes the vertex of a cell if the surface crosses the cell. cell has the indices of the sample
 * that is the cell's first corner. */
static void add_vertex(struct net *net, const int cell[3]) {
    double sum[3] = {0.0}, gradient[3];
    int n = 0;
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < 4; k++) {
            int from[3] = {cell[0], cell[1], cell[2]};
            from[(axis + 1) % 3] += k & 1;
            from[(axis + 2) % 3] += k >> 1;
            n += add_crossing(net, from, axis, sum);
        }
    if (n == 0)
        return;
    double at[3];
    int wall[3];
    for (int c = 0; c < 3; c++) {
        at[c] = sum[c] / n;
        /* Walls and floor are flat. */
        wall[c] = cell[c] < 0 && c < 2 ? -1 : cell[c] == net->n[c] - 1;
        if (wall[c] != 0)
            at[c] = wall[c] < 0 ? 0.0 : net->size[c];
    }
    const double u = at[0] / net->size[0], v = at[1] / net->size[1];
    shell_ray_value(net->shell, u, v, at[2], gradient);
    struct vec3 normal = vec3(-gradient[0], -gradient[1], -gradient[2]);
    if (wall[0] != 0 || wall[1] != 0 || wall[2] != 0)
        normal = vec3(wall[0], -wall[1], -wall[2]);
    else if (!(vec3_length(normal) > 0.0))
        normal = vec3(0, 0, 1);
    normal = vec3_unit(normal);
    const struct mdf_mesh_vertex vertex = {
        {(float)at[0], (float)(net->size[1] - at[1]), (float)-at[2]},
        {(float)normal.x, (float)normal.y, (float)normal.z},
        {(float)u, (float)v},
    };
    g_array_append_val(net->vertices, vertex);
    net->vertex[cell_index(net, cell)] = net->vertices->len;
}

/* Makes two triangles between two samples that follow each other along axis, if one is opaque and
 * the other free. */
static void add_quad(struct net *net, const int from[3], int axis) {
    int to[3] = {from[0], from[1], from[2]};
    to[axis]++;
    const gboolean opaque = sample(net, from) >= 0.0;
    if (opaque == (sample(net, to) >= 0.0))
        return;
    guint32 corner[4];
    for (int k = 0; k < 4; k++) {
        int cell[3] = {from[0], from[1], from[2]};
        cell[(axis + 1) % 3] -= k == 0 || k == 3;
        cell[(axis + 2) % 3] -= k < 2;
        corner[k] = net->vertex[cell_index(net, cell)] - 1;
    }
    /* corner[0] to corner[3] run counter-clockwise around +axis in the frame (u, v, depth). This
     * frame is right-handed, because y is −v and z is −depth. */
    const int order[2][6] = {{0, 3, 2, 0, 2, 1}, {0, 1, 2, 0, 2, 3}};
    for (int k = 0; k < 6; k++)
        g_array_append_val(net->indices, corner[order[opaque][k]]);
}

static int by_value(gconstpointer a, gconstpointer b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Returns the median of g at the points where the measured rays stop, or 0.5 if there are none. */
static double level_of(const struct mdf_shell *shell, const struct mdf_table *t) {
    const int n_views = t->n_measured > 0 ? t->n_measured : t->n_views;
    const gsize n = (gsize)t->width * t->height;
    g_autoptr(GArray) values = g_array_new(FALSE, FALSE, sizeof(double));
    for (int view = 0; view < n_views; view++) {
        const double slant = tan((double)t->theta_deg[view] * DEG);
        const double dx = -slant * cos((double)t->phi_deg[view] * DEG) / shell->width_mm;
        const double dy = slant * sin((double)t->phi_deg[view] * DEG) / shell->height_mm;
        for (gsize k = 0; k < n; k++) {
            const double depth = (double)t->depth_mm[view * n + k];
            double unused[3];
            if (t->seen != NULL && !t->seen[view * n + k])
                continue;
            const int column = (int)(k % (gsize)t->width), row = (int)(k / (gsize)t->width);
            const double g = shell_ray_value(shell, (column + 0.5) / t->width + depth * dx,
                                             (row + 0.5) / t->height + depth * dy, depth, unused);
            g_array_append_val(values, g);
        }
    }
    if (values->len == 0)
        return 0.5;
    qsort(values->data, values->len, sizeof(double), by_value);
    return g_array_index(values, double, values->len / 2);
}

struct mdf_mesh *mdf_mesh_new(const struct mdf_shell *shell, const struct mdf_table *table) {
    struct net net = {.shell = shell,
                      .n = {shell->width, shell->height, shell->depth + 1},
                      .size = {shell->width_mm, shell->height_mm,
                               shell->depth_mm * (shell->depth + 1) / shell->depth},
                      .level = CLAMP(level_of(shell, table), 0.05, 0.95),
                      .vertices = g_array_new(FALSE, FALSE, sizeof(struct mdf_mesh_vertex)),
                      .indices = g_array_new(FALSE, FALSE, sizeof(guint32))};
    g_autofree guint32 *vertex =
        g_new0(guint32, ((gsize)net.n[0] + 1) * (net.n[1] + 1) * (net.n[2] + 1));
    net.vertex = vertex;
    int at[3];
    for (at[2] = -1; at[2] < net.n[2]; at[2]++)
        for (at[1] = -1; at[1] < net.n[1]; at[1]++)
            for (at[0] = -1; at[0] < net.n[0]; at[0]++)
                add_vertex(&net, at);
    for (int axis = 0; axis < 3; axis++)
        for (at[2] = -(axis == 2); at[2] < net.n[2]; at[2]++)
            for (at[1] = -(axis == 1); at[1] < net.n[1]; at[1]++)
                for (at[0] = -(axis == 0); at[0] < net.n[0]; at[0]++)
                    add_quad(&net, at, axis);
    struct mdf_mesh *mesh = g_new0(struct mdf_mesh, 1);
    mesh->n_vertices = net.vertices->len;
    mesh->n_indices = net.indices->len;
    mesh->vertices = (struct mdf_mesh_vertex *)(gpointer)g_array_free(net.vertices, FALSE);
    mesh->indices = (guint32 *)(gpointer)g_array_free(net.indices, FALSE);
    return mesh;
}

void mdf_mesh_free(struct mdf_mesh *mesh) {
    if (mesh == NULL)
        return;
    g_free(mesh->vertices);
    g_free(mesh->indices);
    g_free(mesh);
}
