#include "reference.h"

#include "base/work.h"
#include "btf/btf.h"
#include "directions/directions.h"
#include "exr/exr.h"
#include "lamp.h"
#include "material/material.h"
#include "mdf/reprojection.h"
#include "session/session.h"

#include <math.h>
#include <string.h>

#define PARTS   32 /* number of parts into which the samples are divided for the threads */
#define DEGREES (float)(180.0 / G_PI)

G_DEFINE_QUARK(reference_error, reference_error)

struct Reference {
    /* a compressed material; NULL for a BTF, which the following members describe */
    mesorig_material *material;
    GPtrArray *files;              /* paths, one per view */
    GPtrArray *names;              /* of the parts, one per light */
    GArray *view_theta, *view_phi; /* of float, degrees */
    GArray *light_theta, *light_phi;
    int width, height;
    Reprojection *reprojection; /* NULL if views are mixed texel by texel, not along the surface */
};

/* Largest number of views that are mixed at a point of the surface. Those with the largest weights
 * are used. */
#define ALONG 6

/* The surface point that a sample shows, and the views that see this point. Used for samples that
 * are predicted along the surface (reprojection.h). */
struct along {
    gboolean seen;
    float p[3]; /* the surface point, mm */
    int n;
    guint16 view[ALONG];
    float share[ALONG]; /* weight of the view if the view sees the point completely */
};

/* One sample of the picture that shows the mesh. */
struct sample {
    guint32 at;                   /* index in the picture */
    struct endless_places places; /* where the sample's material is read, in texels */
    struct direction_weights view, light;
    float sum[3];
};

struct shading {
    const Reference *reference;
    const struct viewer_settings *settings;
    const Directions *views, *lights;
    struct sample *samples;
    struct along *along; /* one for each sample; NULL if views are mixed texel by texel */
    guint n_samples;
    const float *texel, *view; /* viewer_render_geometry() of TEXEL and of VIEW */
    /* viewer_render_geometry() of LIGHT and of LIT, for the lamp whose light is being added */
    const float *light, *lit;
    /* `rgb` is the colour of the lamp whose light is being added. `ambient` is the brightness of an
     * even sky that is added together with this lamp. */
    double rgb[3], ambient;
    /* The view that is in memory. It has one layer for each light, then one for the pole of the
     * lights and one for an even sky. Each layer is height × width × 4: R, G, B and an unused
     * value. */
    float *layers;
    gsize layer_size; /* in floats */
    /* Weights of the lights: `pole` for the layer of the pole, and `sky` for the layer of the even
     * sky. */
    const float *pole, *sky;
    float *means;                  /* mean R, G, B of each layer */
    const struct index_map *index; /* index map; NULL if there is none */
    const struct endless *endless; /* hexagons; NULL if there are none */
    struct endless_lattice lattice;
    int width, height; /* number of texels after which the drawn pattern repeats */
    int view_index;
    /* weight of the view in memory in the mean that stands for the pole of the views */
    float pole_share;
};

void reference_free(Reference *r) {
    if (r == NULL)
        return;
    mesorig_material_close(r->material);
    reprojection_free(r->reprojection);
    if (r->material != NULL) {
        g_free(r);
        return;
    }
    g_ptr_array_unref(r->files);
    g_ptr_array_unref(r->names);
    g_array_unref(r->view_theta);
    g_array_unref(r->view_phi);
    g_array_unref(r->light_theta);
    g_array_unref(r->light_phi);
    g_free(r);
}

static int compare_names(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static gboolean reference_read_direction(const struct exr_part *part, const char *of,
                                         float *ret_theta, float *ret_phi, GError **error) {
    if (btf_direction(part, of, ret_theta, ret_phi))
        return TRUE;
    g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                "part %s: the attribute %s.theta_deg or %s.phi_deg is missing or not a number",
                part->name, of, of);
    return FALSE;
}

/* Takes the names and directions of the lights, and the numbers of texels, from the first file. */
static gboolean reference_take_lights(Reference *r, const struct exr_file *file, GError **error) {
    for (guint k = 0; k < file->parts->len; k++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, k);
        float theta, phi;
        if (!g_str_has_prefix(part->name, "light_"))
            continue;
        if (!reference_read_direction(part, "light", &theta, &phi, error))
            return FALSE;
        g_ptr_array_add(r->names, g_strdup(part->name));
        g_array_append_val(r->light_theta, theta);
        g_array_append_val(r->light_phi, phi);
        r->width = part->width;
        r->height = part->height;
    }
    return TRUE;
}

static gboolean reference_take_view(Reference *r, const char *path, GError **error) {
    struct exr_file *headers = exr_read_headers(path, error);
    if (headers == NULL)
        return FALSE;
    float theta = 0.0f, phi = 0.0f;
    g_autoptr(GError) why = NULL;
    gboolean good =
        (r->names->len > 0 || reference_take_lights(r, headers, &why)) && r->names->len > 0;
    for (guint k = 0; good && k < r->names->len; k++) {
        const struct exr_part *part = exr_file_part(headers, r->names->pdata[k]);
        good = part != NULL && part->width == r->width && part->height == r->height &&
               reference_read_direction(part, "view", &theta, &phi, &why);
    }
    exr_file_free(headers);
    g_array_append_val(r->view_theta, theta);
    g_array_append_val(r->view_phi, phi);
    if (!good)
        g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                    "%s: %s; delete the file and process the session again", path,
                    why != NULL ? why->message
                    : r->names->len > 0
                        ? "its lights or texels differ from those of the other views"
                        : "it has no lights");
    return good;
}

Reference *reference_open(const char *btf, GError **error) {
    g_autoptr(Reference) r = g_new0(Reference, 1);
    r->files = g_ptr_array_new_with_free_func(g_free);
    r->names = g_ptr_array_new_with_free_func(g_free);
    r->view_theta = g_array_new(FALSE, FALSE, sizeof(float));
    r->view_phi = g_array_new(FALSE, FALSE, sizeof(float));
    r->light_theta = g_array_new(FALSE, FALSE, sizeof(float));
    r->light_phi = g_array_new(FALSE, FALSE, sizeof(float));
    g_autoptr(GDir) dir = g_dir_open(btf, 0, NULL);
    for (const char *name; dir != NULL && (name = g_dir_read_name(dir)) != NULL;)
        if (g_str_has_prefix(name, "view_") && g_str_has_suffix(name, ".exr"))
            g_ptr_array_add(r->files, g_build_filename(btf, name, NULL));
    g_ptr_array_sort(r->files, compare_names);
    if (r->files->len == 0) {
        g_set_error(
            error, REFERENCE_ERROR, REFERENCE_ERROR_NONE,
            "there is no BTF (view_….exr) in %s; run “mesorig process” on the session first", btf);
        return NULL;
    }
    for (guint k = 0; k < r->files->len; k++)
        if (!reference_take_view(r, r->files->pdata[k], error))
            return NULL;
    return g_steal_pointer(&r);
}

Reference *reference_open_material(const char *path, GError **error) {
    struct mesorig_error why;
    mesorig_material *material = mesorig_material_open(path, NULL, &why);
    if (material == NULL) {
        g_set_error_literal(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT, why.text);
        return NULL;
    }
    Reference *r = g_new0(Reference, 1);
    r->material = material;
    return r;
}

gboolean reference_move_along_surface(Reference *r, const char *mdf, GError **error) {
    g_return_val_if_fail(r->files != NULL, FALSE);
    const struct reference_info info = reference_info(r);
    r->reprojection = session_check_product(mdf, error)
                          ? reprojection_read(mdf, info.view_theta_deg, info.view_phi_deg,
                                              info.n_views, TRUE, error)
                          : NULL;
    if (r->reprojection == NULL)
        return FALSE;
    const struct mdf_plane *plane = reprojection_plane(r->reprojection);
    if (plane->width == r->width && plane->height == r->height)
        return TRUE;
    g_set_error(
        error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
        "%s: the MDF has %d × %d texels, but the BTF has %d × %d; process the session again", mdf,
        plane->width, plane->height, r->width, r->height);
    return FALSE;
}

static Directions *view_directions(const Reference *r, GError **error) {
    const struct reference_info info = reference_info(r);
    return directions_new(info.view_theta_deg, info.view_phi_deg, info.n_views, error);
}

static Directions *light_directions(const Reference *r, GError **error) {
    return directions_new((const float *)(const void *)r->light_theta->data,
                          (const float *)(const void *)r->light_phi->data, r->names->len, error);
}

/* Finds the surface point of a sample, and the views that see it. */
static void reference_trace(const struct shading *s, const struct sample *sample, struct vec3 v,
                            struct along *ret) {
    const Reprojection *r = s->reference->reprojection;
    const struct mdf_plane *plane = reprojection_plane(r);
    const double at_mm[] = {(sample->places.x[0][0] - 0.5 * plane->width) * plane->texel_mm,
                            (0.5 * plane->height - sample->places.x[0][1]) * plane->texel_mm};
    struct reprojection_weights weights;
    struct reprojection_hit hit;
    struct reprojection_tap taps[REPROJECTION_VIEW_TAPS];
    float share[REPROJECTION_MAX_VIEWS] = {0}, kept = 0.0f;
    v = vec3_unit(vec3(v.x, v.y, fmax(v.z, 0.05)));
    reprojection_weigh(r, at_mm, v, &weights);
    reprojection_trace(r, at_mm, v, &weights, &hit);
    *ret = (struct along){.seen = hit.seen, .p = {hit.p.x, hit.p.y, hit.p.z}};
    for (int k = 0; k < weights.n; k++) {
        const int n = reprojection_look(r, &hit, &weights, k, taps);
        share[k] = 0.0f;
        for (int i = 0; i < n; i++)
            share[k] += taps[i].weight;
    }
    for (; ret->n < ALONG; ret->n++) {
        int best = 0;
        for (int k = 1; k < weights.n; k++)
            if (share[k] > share[best])
                best = k;
        if (share[best] <= 0.0f)
            break;
        kept += share[best];
        share[best] = 0.0f;
        ret->view[ret->n] = weights.view[best];
        ret->share[ret->n] = (hit.seen ? weights.value : weights.flat)[best] / hit.weight;
    }
    for (int k = 0; k < ret->n; k++)
        ret->share[k] /= kept;
}

/* Finds the places of the sample that a point of the mesh shows, in tiles. There are several places
 * only if the sample is laid out in hexagons and style.nearest is not set. */
static void reference_find_places(const struct shading *s, const float texel[2],
                                  struct endless_places *ret) {
    *ret = (struct endless_places){.n = 1, .x = {{texel[0], texel[1]}}, .weight = {1}};
    if (s->endless == NULL)
        return;
    endless_find(s->endless, &s->lattice, texel, ret);
    if (!s->settings->style.nearest)
        return;
    ret->n = 1;
    ret->weight[0] = 1;
    ret->mean = 0;
}

/* Finds the weights of the views and lights for a part of the samples. */
static void reference_prepare(int part, gpointer data) {
    const struct shading *s = data;
    const guint64 n = s->n_samples;
    for (guint64 k = n * part / PARTS; k < n * (part + 1) / PARTS; k++) {
        struct sample *sample = &s->samples[k];
        const gsize at = 4 * (gsize)sample->at;
        const float *texel = s->texel + at, *v = s->view + at, *l = s->light + at;
        const float size[] = {(float)s->reference->width, (float)s->reference->height};
        const float period[] = {(float)s->width, (float)s->height};
        reference_find_places(s, texel, &sample->places);
        for (int i = 0; i < sample->places.n; i++)
            for (int c = 0; c < 2; c++) {
                const float x = sample->places.x[i][c] * size[c];
                sample->places.x[i][c] = x - floorf(x / period[c]) * period[c];
            }
        directions_weights(s->views, vec3(v[0], v[1], v[2]), &sample->view);
        if (s->along != NULL)
            reference_trace(s, sample, vec3(v[0], v[1], v[2]), &s->along[k]);
        directions_weights(s->lights, vec3(l[0], l[1], l[2]), &sample->light);
        float fade = l[2] >= 0.0f ? directions_fade(s->lights, vec3(l[0], l[1], l[2])) : 0.0;
        fade *= s->lit[at];
        for (int i = 0; i < 4; i++)
            sample->light.weight[i] *= fade;
    }
}

/* Returns R, G and B of a layer at the texel (i, j) of the drawn pattern. With an index map, these
 * are the values of the texel of the sample that the map shows there. */
static const float *shading_texel(const struct shading *s, const float *texels, int i, int j) {
    if (s->index != NULL) {
        const guint16 *at = s->index->levels[0] + 2 * ((gsize)j * s->index->width + i);
        i = at[0];
        j = at[1];
    }
    return texels + 4 * ((gsize)j * s->reference->width + i);
}

/* Adds share times the value of a layer to sum, at a place of the sample in texels. The value is
 * interpolated bilinearly. With style.nearest, the value of the nearest texel is used instead. */
static void add_place(const struct shading *s, int layer, const float place[2], float share,
                      float sum[3]) {
    const float *texels = s->layers + s->layer_size * layer;
    const gboolean nearest = s->settings->style.nearest;
    const int width = s->width, height = s->height;
    float x = nearest ? floorf(place[0]) : place[0] - 0.5f;
    float y = nearest ? floorf(place[1]) : place[1] - 0.5f;
    float fx = x - floorf(x), fy = y - floorf(y);
    int i = ((int)floorf(x) + width) % width, j = ((int)floorf(y) + height) % height;
    int right = (i + 1) % width, down = (j + 1) % height;
    const float *a = shading_texel(s, texels, i, j), *b = shading_texel(s, texels, right, j);
    const float *c = shading_texel(s, texels, i, down);
    const float *d = shading_texel(s, texels, right, down);
    for (int k = 0; k < 3; k++)
        sum[k] +=
            share * ((1.0f - fy) * (a[k] + fx * (b[k] - a[k])) + fy * (c[k] + fx * (d[k] - c[k])));
}

/* Adds share times the value of a layer at all places of a sample to sum. */
static void add_layer(const struct shading *s, int layer, const struct sample *at, float share,
                      float sum[3]) {
    const struct endless_places *p = &at->places;
    for (int k = 0; k < p->n; k++)
        add_place(s, layer, p->x[k], share * p->weight[k], sum);
    for (int k = 0; p->mean != 0.0f && k < 3; k++)
        sum[k] += share * p->mean * s->means[3 * layer + k];
}

/* Adds share times the value of a layer to sum. The value is read at the taps, where the view in
 * memory sees the surface point of the sample. */
static void add_taps(const struct shading *s, int layer, const struct reprojection_tap *taps, int n,
                     float share, float sum[3]) {
    const float *texels = s->layers + s->layer_size * layer;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            sum[k] += share * taps[i].weight * texels[4 * (gsize)taps[i].texel + k];
}

/* Does the work of reference_shade() for samples that are predicted along the surface. */
static void reference_shade_along(int part, gpointer data) {
    const struct shading *s = data;
    const guint64 n = s->n_samples;
    const int n_lights = (int)s->reference->names->len;
    for (guint64 k = n * part / PARTS; k < n * (part + 1) / PARTS; k++) {
        struct sample *sample = &s->samples[k];
        const struct along *along = &s->along[k];
        for (int i = 0; i < along->n; i++) {
            if (along->view[i] != s->view_index)
                continue;
            const float share = along->share[i];
            const struct reprojection_weights weights = {1, {s->view_index}, {share}, {share}, {0}};
            const struct reprojection_hit hit = {
                .seen = along->seen, .p = {along->p[0], along->p[1], along->p[2]}, .weight = 1.0};
            struct reprojection_tap taps[REPROJECTION_VIEW_TAPS];
            const int n_taps =
                reprojection_look(s->reference->reprojection, &hit, &weights, 0, taps);
            float lamp[3] = {0.0F};
            for (int l = 0; l < 4; l++)
                if (sample->light.weight[l] != 0.0f)
                    add_taps(s, sample->light.index[l], taps, n_taps, sample->light.weight[l],
                             lamp);
            for (int c = 0; c < 3; c++)
                sample->sum[c] += (float)s->rgb[c] * lamp[c];
            if (s->ambient != 0.0)
                add_taps(s, n_lights + 1, taps, n_taps, (float)s->ambient, sample->sum);
        }
    }
}

/* Adds the contribution of the view in memory to a part of the samples. When all views have been
 * added, a sample has
 *     rgb × Σ_a Σ_b g_a(v) h_b(l) BTF(x, v_a, l_b) + ambient × Σ_a g_a(v) sky_a(x).
 * g_a are the weights of the views (sample->view), and h_b those of the lights (sample->light).
 * sky_a is the layer of the even sky in view a. */
static void reference_shade(int part, gpointer data) {
    const struct shading *s = data;
    const guint64 n = s->n_samples;
    const int n_lights = (int)s->reference->names->len;
    for (guint64 k = n * part / PARTS; k < n * (part + 1) / PARTS; k++) {
        struct sample *sample = &s->samples[k];
        float share = 0.0f;
        for (int i = 0; i < 4; i++)
            if (sample->view.index[i] == s->view_index)
                share += sample->view.weight[i];
            else if (sample->view.index[i] == (int)s->reference->files->len)
                share += sample->view.weight[i] * s->pole_share;
        if (share == 0.0f)
            continue;
        float lamp[3] = {0.0F};
        for (int i = 0; i < 4; i++)
            if (sample->light.weight[i] != 0.0f)
                add_layer(s, sample->light.index[i], sample, share * sample->light.weight[i], lamp);
        for (int c = 0; c < 3; c++)
            sample->sum[c] += (float)s->rgb[c] * lamp[c];
        if (s->ambient != 0.0)
            add_layer(s, n_lights + 1, sample, share * s->ambient, sample->sum);
    }
}

/* Reads R, G and B of each texel under each light from a file. ret has `stride` floats per texel,
 * of which only the first three are set. */
static gboolean reference_read_file(const Reference *r, const char *path, int stride, float *ret,
                                    GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    const gsize texels = (gsize)r->width * r->height;
    struct exr_file *file = session_check_product(path, error) ? exr_read(path, error) : NULL;
    if (file == NULL)
        return FALSE;
    gboolean good = TRUE;
    for (guint light = 0; good && light < r->names->len; light++) {
        const struct exr_part *part = exr_file_part(file, r->names->pdata[light]);
        good = part != NULL && part->width == r->width && part->height == r->height;
        for (int c = 0; good && c < 3; c++) {
            const float *plane = exr_part_plane(part, channels[c]);
            good = plane != NULL;
            for (gsize k = 0; good && k < texels; k++)
                ret[stride * (texels * light + k) + c] = isfinite(plane[k]) ? plane[k] : 0.0f;
        }
    }
    exr_file_free(file);
    if (!good)
        g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                    "%s: a light or a colour is missing, or a light has another size than those of "
                    "the first view; delete the file and process the session again",
                    path);
    return good;
}

gboolean reference_read_view(const Reference *r, int view, float *ret, GError **error) {
    return reference_read_file(r, r->files->pdata[view], 3, ret, error);
}

struct reference_info reference_info(const Reference *r) {
    return (struct reference_info){
        .width = r->width,
        .height = r->height,
        .n_views = (int)r->files->len,
        .n_lights = (int)r->names->len,
        .view_theta_deg = (const float *)(const void *)r->view_theta->data,
        .view_phi_deg = (const float *)(const void *)r->view_phi->data,
        .light_theta_deg = (const float *)(const void *)r->light_theta->data,
        .light_phi_deg = (const float *)(const void *)r->light_phi->data,
    };
}

/* Computes the mean R, G and B of each layer of the view in memory. */
static void reference_find_means(const struct shading *s) {
    const gsize n = s->layer_size / 4;
    for (guint layer = 0; layer < s->reference->names->len + 2; layer++) {
        const float *texels = s->layers + s->layer_size * layer;
        double sums[3] = {0.0};
        for (gsize k = 0; k < 4 * n; k++)
            if (k % 4 < 3)
                sums[k % 4] += texels[k];
        for (int k = 0; k < 3; k++)
            s->means[3 * layer + k] = (float)(sums[k] / (double)n);
    }
}

/* Computes the layers of the pole and of the even sky from the other layers of the view in
 * memory. */
static void mix_layers(struct shading *s) {
    const gsize n = s->layer_size;
    const int n_lights = (int)s->reference->names->len;
    float *pole = s->layers + n * n_lights, *sky = pole + n;
    memset(pole, 0, 2 * n * sizeof(float));
    for (int light = 0; light < n_lights; light++) {
        const float *texels = s->layers + n * light;
        for (gsize k = 0; k < n; k++) {
            pole[k] += s->pole[light] * texels[k];
            sky[k] += s->sky[light] * texels[k];
        }
    }
}

/* Loads one view after the other and adds its contribution to all samples. */
static gboolean shade_samples(struct shading *s, GError **error) {
    const Reference *r = s->reference;
    g_autoptr(Directions) views = view_directions(r, error);
    g_autoptr(Directions) lights = views != NULL ? light_directions(r, error) : NULL;
    if (lights == NULL)
        return FALSE;
    s->views = views;
    s->lights = lights;
    s->layer_size = 4 * (gsize)r->width * r->height;
    g_autofree float *layers = g_try_new0(float, s->layer_size *(r->names->len + 2));
    g_autofree float *pole_share = g_new0(float, r->names->len), *sky = g_new(float, r->names->len);
    g_autofree float *means = g_new0(float, 3 * (r->names->len + 2));
    int n_pole;
    const int *pole = directions_pole(lights, &n_pole);
    for (int k = 0; k < n_pole; k++)
        pole_share[pole[k]] += 1.0f / n_pole;
    directions_sky(lights, sky);
    s->layers = layers;
    s->means = means;
    s->pole = pole_share;
    s->sky = sky;
    if (layers == NULL) {
        g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                    "a view of %u lights and %d × %d texels needs %.1f GiB of memory, which the "
                    "system refused; close other programs",
                    r->names->len, r->width, r->height,
                    (double)s->layer_size * sizeof(float) * (r->names->len + 2) / (1 << 30));
        return FALSE;
    }
    work_for_each(0, PARTS, reference_prepare, s);
    pole = directions_pole(views, &n_pole);
    for (guint v = 0; v < r->files->len; v++) {
        s->view_index = v;
        s->pole_share = 0.0f;
        for (int k = 0; k < n_pole; k++)
            s->pole_share += pole[k] == (int)v ? 1.0f / n_pole : 0.0f;
        if (!reference_read_file(r, r->files->pdata[v], 4, layers, error))
            return FALSE;
        mix_layers(s);
        if (s->endless != NULL)
            reference_find_means(s);
        work_for_each(0, PARTS, s->along != NULL ? reference_shade_along : reference_shade, s);
    }
    return TRUE;
}

/* Data of reference_shade_part(), which shades samples by a compressed material. */
struct material_shading {
    const struct shading *shading;
    const mesorig_material *material;
    struct mesorig_material_info info;
    const float *lights; /* unit vectors towards the lights: n_lights × 3 */
    /* weight of each light under an even sky */
    const float *sky;
};

/* Adds light to sample->sum, multiplied by weight. The light is rgb × lit × (reflectance under the
 * lamp) + ambient × Σ_l sky_l × (reflectance under light l). footprint is 0 for a point of the
 * sample, or 1 for the mean of the sample. */
static void reference_add_point(const struct material_shading *m, struct sample *sample,
                                const float uv[2], float footprint, float weight) {
    const struct shading *s = m->shading;
    const gsize at = 4 * (gsize)sample->at;
    const float *v = s->view + at;
    float rgb[3];
    /* Interpolated normals may put a view below the horizon. It is clamped to the horizon. */
    const float view[] = {v[0], v[1], fmaxf(v[2], 1e-4f)};
    mesorig_material_evaluate(m->material, 1, uv, view, s->light + at, &footprint, rgb);
    for (int c = 0; c < 3; c++)
        sample->sum[c] += weight * (float)s->rgb[c] * s->lit[at] * rgb[c];
    for (int l = 0; s->ambient != 0.0 && l < m->info.n_lights; l++) {
        if (m->sky[l] == 0.0f)
            continue;
        mesorig_material_evaluate(m->material, 1, uv, view, m->lights + 3 * l, &footprint, rgb);
        for (int c = 0; c < 3; c++)
            sample->sum[c] += weight * s->ambient * m->sky[l] * rgb[c];
    }
}

static void reference_shade_point(const struct material_shading *m, struct sample *sample) {
    const struct shading *s = m->shading;
    const gsize at = 4 * (gsize)sample->at;
    struct endless_places places;
    reference_find_places(s, s->texel + at, &places);
    for (int k = 0; k < places.n; k++) {
        float uv[] = {places.x[k][0], places.x[k][1]};
        if (s->settings->style.nearest) {
            uv[0] = (floorf(uv[0] * m->info.width) + 0.5f) / m->info.width;
            uv[1] = (floorf(uv[1] * m->info.height) + 0.5f) / m->info.height;
        }
        reference_add_point(m, sample, uv, 0, places.weight[k]);
    }
    if (places.mean != 0)
        reference_add_point(m, sample, (const float[]){0.5f, 0.5f}, 1, places.mean);
}

static void reference_shade_part(int part, gpointer data) {
    const struct material_shading *m = data;
    const guint64 n = m->shading->n_samples;
    for (guint64 k = n * part / PARTS; k < n * (part + 1) / PARTS; k++)
        reference_shade_point(m, &m->shading->samples[k]);
}

static gboolean shade_by_material(struct shading *s, const mesorig_material *material,
                                  GError **error) {
    struct material_shading m = {s, material, {.size = sizeof m.info}};
    mesorig_material_info(material, &m.info);
    const int n = m.info.n_lights;
    g_autofree float *lights = g_new(float, 3 * n), *sky = g_new(float, n);
    g_autofree float *theta = g_new(float, n), *phi = g_new(float, n);
    mesorig_material_directions(material, NULL, lights);
    for (int l = 0; l < n; l++) {
        theta[l] = atan2f(hypotf(lights[3 * l], lights[3 * l + 1]), lights[3 * l + 2]) * DEGREES;
        phi[l] = atan2f(lights[3 * l + 1], lights[3 * l]) * DEGREES;
    }
    g_autoptr(Directions) directions = directions_new(theta, phi, n, error);
    if (directions == NULL)
        return FALSE;
    directions_sky(directions, sky);
    m.lights = lights;
    m.sky = sky;
    work_for_each(0, PARTS, reference_shade_part, &m);
    return TRUE;
}

/* Replaces the pixels that the viewer has drawn by the samples. Adds the squares of the samples'
 * values to *squares, and the squares of their differences from the viewer's picture to
 * *differences. */
static void put_samples(const struct shading *s, float *picture, double *squares,
                        double *differences) {
    for (guint k = 0; k < s->n_samples; k++)
        for (int c = 0; c < 3; c++) {
            float *there = &picture[4 * (gsize)s->samples[k].at + c];
            double value = fmax(s->samples[k].sum[c], 0.0);
            *squares += value * value;
            *differences += (*there - value) * (*there - value);
            *there = value;
        }
}

/* Adds the light of one lamp and of the even sky to the samples. The settings `lamp` have this lamp
 * and no other. rgb is the colour of the lamp. */
static gboolean add_lamp(struct shading *s, const Reference *r, Viewer *viewer,
                         const struct viewer_settings *lamp, const float rgb[3], int width,
                         int height, GError **error) {
    g_autofree float *light =
        viewer_render_geometry(viewer, lamp, VIEWER_GEOMETRY_LIGHT, width, height, error);
    g_autofree float *lit =
        light != NULL
            ? viewer_render_geometry(viewer, lamp, VIEWER_GEOMETRY_LIT, width, height, error)
            : NULL;
    if (lit == NULL)
        return FALSE;
    s->light = light;
    s->lit = lit;
    s->ambient = lamp->ambient;
    for (int c = 0; c < 3; c++)
        s->rgb[c] = (double)rgb[c];
    return r->material != NULL ? shade_by_material(s, r->material, error) : shade_samples(s, error);
}

/* Adds one lamp after the other: the first lamp with the sky, and then the further lamps. */
static gboolean add_lamps(struct shading *shading, const Reference *r, Viewer *viewer, int width,
                          int height, GError **error) {
    const struct viewer_settings lit = lamp_settings(shading->settings);
    struct viewer_settings one = lit;
    const float first[3] = {(float)lit.lamp, (float)lit.lamp, (float)lit.lamp};
    one.n_lamps = 0;
    if ((lit.lamp > 0.0 || lit.ambient > 0.0 || lit.n_lamps == 0) &&
        !add_lamp(shading, r, viewer, &one, first, width, height, error))
        return FALSE;
    one.lamp = one.ambient = 0.0;
    one.n_lamps = 1;
    for (int k = 0; k < lit.n_lamps; k++) {
        one.lamps[0] = lit.lamps[k];
        if (!add_lamp(shading, r, viewer, &one, lit.lamps[k].rgb, width, height, error))
            return FALSE;
    }
    return TRUE;
}

/* Shades the samples that show the material with this number. shading->texel and shading->view must
 * be set. */
static gboolean shade_material_number(Reference *r, int number, struct shading *shading,
                                      Viewer *viewer, int width, int height, GError **error) {
    g_autoptr(GArray) samples = g_array_new(FALSE, TRUE, sizeof(struct sample));
    for (gsize k = 0; k < (gsize)width * height; k++)
        if (shading->texel[4 * k + 3] > 0.5f &&
            (int)lrintf(shading->texel[4 * k + 2]) == number + 1) {
            const struct sample sample = {.at = k};
            g_array_append_val(samples, sample);
        }
    const struct index_map *index = number == 0 ? viewer_index(viewer) : NULL;
    if (index != NULL && (index->sample_width != r->width || index->sample_height != r->height)) {
        g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                    "the index map is for a sample of %d × %d texels, but the BTF has %d × %d; "
                    "synthesize the map from this session",
                    index->sample_width, index->sample_height, r->width, r->height);
        return FALSE;
    }
    shading->endless =
        number == 0 ? viewer_endless(viewer, shading->settings, &shading->lattice) : NULL;
    if ((index != NULL || shading->endless != NULL) && r->reprojection != NULL) {
        g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                    "a picture along the surface can only repeat the sample; leave out --index and "
                    "--endless");
        return FALSE;
    }
    shading->reference = r;
    shading->index = index;
    shading->width = index != NULL ? index->width : r->width;
    shading->height = index != NULL ? index->height : r->height;
    shading->n_samples = samples->len;
    shading->along = r->reprojection != NULL ? g_new(struct along, samples->len) : NULL;
    shading->samples = (struct sample *)(void *)g_array_free(g_steal_pointer(&samples), FALSE);
    return shading->n_samples == 0 || add_lamps(shading, r, viewer, width, height, error);
}

float *reference_render_scene_linear(Reference *const *references, int n, Viewer *viewer,
                                     const struct viewer_settings *s, int width, int height,
                                     double *ret_error, GError **error) {
    g_autofree float *picture = viewer_render_linear(viewer, s, width, height, error);
    g_autofree float *texel = NULL, *to_view = NULL;
    double squares = 0.0, differences = 0.0;
    if (picture == NULL ||
        !(texel = viewer_render_geometry(viewer, s, VIEWER_GEOMETRY_TEXEL, width, height, error)) ||
        !(to_view = viewer_render_geometry(viewer, s, VIEWER_GEOMETRY_VIEW, width, height, error)))
        return NULL;
    for (int k = 0; k < n; k++) {
        if (references[k] == NULL)
            continue;
        struct shading shading = {.settings = s, .texel = texel, .view = to_view};
        const gboolean good =
            shade_material_number(references[k], k, &shading, viewer, width, height, error);
        if (good)
            put_samples(&shading, picture, &squares, &differences);
        g_free(shading.samples);
        g_free(shading.along);
        if (!good)
            return NULL;
    }
    if (ret_error != NULL)
        *ret_error = squares > 0.0 ? sqrt(differences / squares) : 0.0;
    return g_steal_pointer(&picture);
}

guint8 *reference_render_scene(Reference *const *references, int n, Viewer *viewer,
                               const struct viewer_settings *settings, int width, int height,
                               double *ret_error, GError **error) {
    struct viewer_settings s = *settings;
    while (s.samples > 1 && (gint64)width * height * s.samples * s.samples > REFERENCE_MAX_SAMPLES)
        s.samples--;
    if ((gint64)width * height > REFERENCE_MAX_SAMPLES) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "a reference picture of %d × %d is too large; at most %d pixels are possible",
                    width, height, REFERENCE_MAX_SAMPLES);
        return NULL;
    }
    g_autofree float *linear = reference_render_scene_linear(
        references, n, viewer, &s, width * s.samples, height * s.samples, ret_error, error);
    return linear != NULL ? viewer_resolve(viewer, &s, linear, width, height, error) : NULL;
}
