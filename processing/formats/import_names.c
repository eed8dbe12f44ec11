/* Imports pictures whose names, or a list, contain their directions. */
#include "import_private.h"

#include "base/data_error.h"

#include <math.h>
#include <string.h>

#include "base/input_file.h"

#define STEPS_A_DEG    10000 /* directions within 1/this degree are equal */
#define MAX_LIST_BYTES (64 << 20)

struct direction {
    gint64 theta, phi; /* in steps */
};

struct named {
    char *path;
    struct direction view, light;
    int line; /* line of the list; 0: none */
};

struct pictures {
    const char *source;
    GPtrArray *all;         /* of struct named */
    GArray *views, *lights; /* of struct direction, in order */
    GPtrArray *of;          /* of struct named, view × light */
    int width, height;
};

static void named_free(gpointer data) {
    g_free(((struct named *)data)->path);
    g_free(data);
}

/* The number after a key that does not end a longer word: "tl045.0". FALSE: none, or two. */
static gboolean find_key(const char *name, const char *key, double *ret_deg) {
    const gsize n = strlen(key);
    int found = 0;
    for (const char *at = name; *at; at++) {
        if (g_ascii_strncasecmp(at, key, n) != 0 || !g_ascii_isdigit(at[n]) ||
            (at > name && g_ascii_isalpha(at[-1])))
            continue;
        const gsize whole = strspn(at + n, "0123456789");
        const char *end = at + n + whole;
        const gsize part = *end == '.' ? strspn(end + 1, "0123456789") : 0;
        g_autofree char *number = g_strndup(at + n, whole + (part ? part + 1 : 0));
        *ret_deg = g_ascii_strtod(number, NULL);
        found++;
    }
    return found == 1 && *ret_deg <= 360;
}

static struct direction import_names_direction(double theta_deg, double phi_deg) {
    struct direction d = {llround(theta_deg * STEPS_A_DEG), llround(phi_deg * STEPS_A_DEG)};
    d.phi = ((d.phi % (360 * STEPS_A_DEG)) + 360 * STEPS_A_DEG) % (360 * STEPS_A_DEG);
    d.phi = d.theta == 0 ? 0 : d.phi;
    return d;
}

static int import_names_compare(gconstpointer a, gconstpointer b) {
    const struct direction *x = a, *y = b;
    if (x->theta != y->theta)
        return x->theta < y->theta ? -1 : 1;
    return (x->phi > y->phi) - (x->phi < y->phi);
}

static void sort_once(GArray *directions) {
    guint n = 0;
    g_array_sort(directions, import_names_compare);
    for (guint i = 0; i < directions->len; i++)
        if (n == 0 ||
            import_names_compare(&g_array_index(directions, struct direction, i),
                                 &g_array_index(directions, struct direction, n - 1)) != 0)
            g_array_index(directions, struct direction, n++) =
                g_array_index(directions, struct direction, i);
    g_array_set_size(directions, n);
}

static guint import_names_index_of(const GArray *directions, const struct direction *d) {
    guint at = 0;
    return g_array_binary_search((GArray *)directions, d, import_names_compare, &at) ? at : 0;
}

static gboolean report_missing(const struct pictures *pictures, GError **error) {
    const guint n_lights = pictures->lights->len;
    guint missing = 0, first = 0;
    for (guint i = pictures->views->len * n_lights; i-- > 0;)
        if (!pictures->of->pdata[i]) {
            missing++;
            first = i;
        }
    if (missing == 0)
        return TRUE;
    const struct direction *view =
        &g_array_index(pictures->views, struct direction, first / n_lights);
    const struct direction *light =
        &g_array_index(pictures->lights, struct direction, first % n_lights);
    return data_error_fail(
        pictures->source, 0, error,
        "%u of %u views × %u lights have no picture, the first seen from θ %g° φ %g° "
        "and lit from θ %g° φ %g°",
        missing, pictures->views->len, n_lights, (double)view->theta / STEPS_A_DEG,
        (double)view->phi / STEPS_A_DEG, (double)light->theta / STEPS_A_DEG,
        (double)light->phi / STEPS_A_DEG);
}

/* Arranges the pictures: each view under each light, once. */
static gboolean arrange(struct pictures *pictures, GError **error) {
    for (guint i = 0; i < pictures->all->len; i++) {
        const struct named *named = pictures->all->pdata[i];
        g_array_append_val(pictures->views, named->view);
        g_array_append_val(pictures->lights, named->light);
    }
    sort_once(pictures->views);
    sort_once(pictures->lights);
    g_ptr_array_set_size(pictures->of, (gint)(pictures->views->len * pictures->lights->len));
    for (guint i = 0; i < pictures->all->len; i++) {
        struct named *named = pictures->all->pdata[i];
        const guint view = import_names_index_of(pictures->views, &named->view);
        const guint light = import_names_index_of(pictures->lights, &named->light);
        gpointer *at = &pictures->of->pdata[view * pictures->lights->len + light];
        const struct named *other = *at;
        if (other)
            return data_error_fail(pictures->source, named->line, error,
                                   "%s is of the same view and light as %s; remove one of them",
                                   named->path, other->path);
        *at = named;
    }
    return report_missing(pictures, error);
}

static int import_names_by_text(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static gboolean list_folder(struct pictures *pictures, const char *folder, GError **error) {
    g_autoptr(GDir) dir = g_dir_open(folder, 0, error);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    const char *name;
    if (!dir)
        return FALSE;
    while ((name = g_dir_read_name(dir)))
        g_ptr_array_add(names, g_strdup(name));
    g_ptr_array_sort(names, import_names_by_text);
    for (guint i = 0; i < names->len; i++) {
        name = names->pdata[i];
        double tl, pl, tv, pv;
        if (!import_is_picture(name))
            continue;
        if (!find_key(name, "tl", &tl) || !find_key(name, "pl", &pl) ||
            !find_key(name, "tv", &tv) || !find_key(name, "pv", &pv))
            return data_error_fail(
                folder, 0, error,
                "the name “%s” does not say its directions; expected are tl, pl, tv and "
                "pv, each once and with degrees, as in “tl030 pl090 tv000 pv000.jpg”",
                name);
        struct named *named = g_new0(struct named, 1);
        *named = (struct named){g_build_filename(folder, name, NULL),
                                import_names_direction(tv, pv), import_names_direction(tl, pl), 0};
        g_ptr_array_add(pictures->all, named);
    }
    return pictures->all->len > 0 ||
           data_error_fail(folder, 0, error,
                           "there is no .jpg, .png, .tif or .exr picture in that folder");
}

static int import_names_by_number(gconstpointer a, gconstpointer b) {
    return strverscmp(*(char *const *)a, *(char *const *)b);
}

/* Names of pictures for a list that has none: the lines of "filenames.txt" beside it, or all
 * pictures there in the order of their names, "9.png" before "10.png". */
static GPtrArray *names_beside(const char *list, const char *folder, guint n, GError **error) {
    g_autofree char *other = g_build_filename(folder, "filenames.txt", NULL);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    const gboolean listed = g_file_test(other, G_FILE_TEST_IS_REGULAR);
    if (listed) {
        g_autofree char *text = NULL;
        GError *found = NULL;
        if (!(text = input_file_read_text(other, MAX_LIST_BYTES, &found))) {
            input_file_propagate(found, DATA_ERROR, DATA_ERROR_INVALID, DATA_ERROR_INVALID, error);
            return NULL;
        }
        g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
        for (char **line = lines; *line; line++)
            if (*g_strstrip(*line))
                g_ptr_array_add(names, g_path_get_basename(*line));
    } else {
        g_autoptr(GDir) dir = g_dir_open(folder, 0, error);
        if (!dir)
            return NULL;
        for (const char *name; (name = g_dir_read_name(dir));)
            if (import_is_picture(name))
                g_ptr_array_add(names, g_strdup(name));
        g_ptr_array_sort(names, import_names_by_number);
    }
    if (names->len == n)
        return g_steal_pointer(&names);
    data_error_set(list, 0, error,
                   "it lists %u directions without names of pictures, but %s has %u pictures%s%s; "
                   "move what does not belong to them, or write a picture's name before each "
                   "direction",
                   n, listed ? other : folder, names->len, names->len ? ", the last one " : "",
                   names->len ? (const char *)names->pdata[names->len - 1] : "");
    return NULL;
}

static gboolean import_names_read_list(struct pictures *pictures, const char *list,
                                       GError **error) {
    g_autoptr(GArray) lights = import_lights_read(list, error);
    g_autofree char *folder = g_path_get_dirname(list);
    g_autoptr(GPtrArray) names = NULL;
    if (!lights)
        return FALSE;
    if (!g_array_index(lights, struct import_light, 0).name &&
        !(names = names_beside(list, folder, lights->len, error)))
        return FALSE;
    for (guint i = 0; i < lights->len; i++) {
        const struct import_light *light = &g_array_index(lights, struct import_light, i);
        struct named *named = g_new0(struct named, 1);
        named->path = g_build_filename(folder, names ? names->pdata[i] : light->name, NULL);
        named->line = light->line;
        named->light = import_names_direction(light->theta_deg, light->phi_deg);
        g_ptr_array_add(pictures->all, named);
        if (!g_file_test(named->path, G_FILE_TEST_IS_REGULAR))
            return data_error_fail(list, light->line, error, "there is no picture %s", named->path);
    }
    return TRUE;
}

/* Files of 8 or 16 bits hold numbers only. */
static gboolean may_have_holes(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot && (g_ascii_strcasecmp(dot, ".exr") == 0 || g_ascii_strcasecmp(dot, ".tif") == 0 ||
                   g_ascii_strcasecmp(dot, ".tiff") == 0);
}

static gboolean import_names_give_picture(int view, int light, const struct import_region *region,
                                          float *const *ret_planes, int *ret_holes, gpointer data,
                                          GError **error) {
    const struct pictures *pictures = data;
    const struct named *named =
        pictures->of->pdata[(guint)view * pictures->lights->len + (guint)light];
    const gsize n = (gsize)region->width * (gsize)region->height;
    *ret_holes = 0;
    if (!ret_planes && !may_have_holes(named->path))
        return TRUE;
    g_autoptr(ImportPicture) picture = import_picture_read(named->path, error);
    if (!picture)
        return FALSE;
    if (picture->width != pictures->width || picture->height != pictures->height)
        return data_error_fail(named->line ? pictures->source : named->path, named->line, error,
                               "%s has %d × %d pixels, the first picture %d × %d",
                               named->line ? named->path : "it", picture->width, picture->height,
                               pictures->width, pictures->height);
    for (gsize i = 0; i < n; i++) {
        const gsize x = (gsize)region->x + i % (gsize)region->width;
        const gsize y = (gsize)region->y + i / (gsize)region->width;
        const float *from = picture->rgb + 3 * (y * (gsize)picture->width + x);
        const gboolean good = isfinite(from[0]) && isfinite(from[1]) && isfinite(from[2]);
        for (int c = 0; ret_planes && c < 3; c++)
            ret_planes[c][i] = good ? from[c] : 0;
        *ret_holes += !good;
    }
    return (double)*ret_holes <= IMPORT_MOST_HOLES * (double)n ||
           data_error_fail(named->path, 0, error, "%d of its %zu pixels are not numbers",
                           *ret_holes, n);
}

static void import_names_degrees(const GArray *directions, float **ret_theta_deg,
                                 float **ret_phi_deg) {
    *ret_theta_deg = g_new(float, directions->len);
    *ret_phi_deg = g_new(float, directions->len);
    for (guint i = 0; i < directions->len; i++) {
        const struct direction *d = &g_array_index(directions, struct direction, i);
        (*ret_theta_deg)[i] = (float)((double)d->theta / STEPS_A_DEG);
        (*ret_phi_deg)[i] = (float)((double)d->phi / STEPS_A_DEG);
    }
}

typedef gboolean (*ReadNames)(struct pictures *pictures, const char *source, GError **error);

static gboolean import_named(const char *path, const char *source, ReadNames read_names,
                             const struct import_wish *wish, const struct work *work,
                             struct import_result *ret, GError **error) {
    g_autofree float *view_theta = NULL, *view_phi = NULL, *light_theta = NULL, *light_phi = NULL;
    g_autoptr(GPtrArray) all = g_ptr_array_new_with_free_func(named_free);
    g_autoptr(GPtrArray) of = g_ptr_array_new();
    g_autoptr(GArray) views = g_array_new(FALSE, FALSE, sizeof(struct direction));
    g_autoptr(GArray) lights = g_array_new(FALSE, FALSE, sizeof(struct direction));
    struct pictures pictures = {
        .source = source, .all = all, .views = views, .lights = lights, .of = of};
    if (!read_names(&pictures, source, error) || !arrange(&pictures, error))
        return FALSE;
    const struct named *named = all->pdata[0];
    g_autoptr(ImportPicture) first = import_picture_read(named->path, error);
    if (!first)
        return FALSE;
    pictures.width = first->width;
    pictures.height = first->height;
    g_clear_pointer(&first, import_picture_free);
    import_names_degrees(views, &view_theta, &view_phi);
    import_names_degrees(lights, &light_theta, &light_phi);
    const struct import_material material = {
        .source = source,
        .width = pictures.width,
        .height = pictures.height,
        .texel_mm = wish->texel_mm > 0 ? wish->texel_mm : 1,
        .region = wish->region,
        .n_views = (int)views->len,
        .n_lights = (int)lights->len,
        .view_theta_deg = view_theta,
        .view_phi_deg = view_phi,
        .light_theta_deg = light_theta,
        .light_phi_deg = light_phi,
        .picture = import_names_give_picture,
        .data = &pictures,
    };
    return import_material(path, &material, work, ret, error);
}

gboolean import_pictures(const char *path, const char *folder, const struct import_wish *wish,
                         const struct work *work, struct import_result *ret, GError **error) {
    return import_named(path, folder, list_folder, wish, work, ret, error);
}

gboolean import_rti(const char *path, const char *list, const struct import_wish *wish,
                    const struct work *work, struct import_result *ret, GError **error) {
    return import_named(path, list, import_names_read_list, wish, work, ret, error);
}
