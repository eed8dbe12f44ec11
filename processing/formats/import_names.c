/* Imports pictures whose directions are in their names or in a list. */
#include "import_private.h"

#include "base/data_error.h"

#include <gio/gio.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/input_file.h"
#include "base/text_table.h"
#include "btf/btf.h"
#include "pictures/picture_part.h"

/* number of steps in a degree; directions are rounded to steps before they are compared */
#define STEPS_A_DEG    10000
#define MAX_LIST_BYTES (64 << 20)

struct direction {
    gint64 theta, phi; /* in steps of 1/STEPS_A_DEG degree */
};

struct named {
    char *path;
    struct direction view, light;
    gboolean placed; /* whether the position of the lamp is known (struct import_light) */
    struct vec3 position_mm;
    double exponent;
    int line;         /* line of the list; 0 means that there is no list */
    gboolean counted; /* whether the picture's tone curve is already counted in `look` */
};

struct pictures {
    const char *source;
    GPtrArray *all;         /* all pictures, of struct named */
    GArray *views, *lights; /* of struct direction, in order */
    /* of struct named: the picture for each pair of a view and a light, view × light */
    GPtrArray *of;
    const struct import_wish *wish;
    /* the size and layout of the first picture, without pixels; all pictures must have this size */
    struct import_picture *first;
    struct import_look *look;
    double texel_mm;
    /* mean over the lamps of the squared distance to the middle of the imported texels; 0 if the
     * positions of the lamps are not known */
    double square_mm;
};

static void named_free(gpointer data) {
    g_free(((struct named *)data)->path);
    g_free(data);
}

/* Finds the number after a key in a name, as in "tl045.0". A key must not follow a letter. Returns
 * FALSE if the key is missing or occurs twice, or if the number is above 360. */
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

static int compare(gconstpointer a, gconstpointer b) {
    const struct direction *x = a, *y = b;
    if (x->theta != y->theta)
        return x->theta < y->theta ? -1 : 1;
    return (x->phi > y->phi) - (x->phi < y->phi);
}

static void sort_once(GArray *directions) {
    guint n = 0;
    g_array_sort(directions, compare);
    for (guint i = 0; i < directions->len; i++)
        if (n == 0 || compare(&g_array_index(directions, struct direction, i),
                              &g_array_index(directions, struct direction, n - 1)) != 0)
            g_array_index(directions, struct direction, n++) =
                g_array_index(directions, struct direction, i);
    g_array_set_size(directions, n);
}

static guint index_of(const GArray *directions, const struct direction *d) {
    guint at = 0;
    return g_array_binary_search((GArray *)directions, d, compare, &at) ? at : 0;
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
    return data_error_fail(pictures->source, 0, error,
                           "%u pairs of a view and a light have no picture, although each of %u "
                           "views needs each of %u lights. The first pair without a picture is the "
                           "view from θ %g° φ %g° under the light from θ %g° φ %g°; add the "
                           "missing pictures, or remove all pictures of that view or of that light",
                           missing, pictures->views->len, n_lights,
                           (double)view->theta / STEPS_A_DEG, (double)view->phi / STEPS_A_DEG,
                           (double)light->theta / STEPS_A_DEG, (double)light->phi / STEPS_A_DEG);
}

/* Arranges the pictures by view and light. Fails unless each pair of a view and a light has exactly
 * one picture. */
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
        const guint view = index_of(pictures->views, &named->view);
        const guint light = index_of(pictures->lights, &named->light);
        gpointer *at = &pictures->of->pdata[view * pictures->lights->len + light];
        const struct named *other = *at;
        if (other)
            return data_error_fail(pictures->source, named->line, error,
                                   "%s has the same view and light as %s; remove one of them",
                                   named->path, other->path);
        *at = named;
    }
    return report_missing(pictures, error);
}

static int by_text(gconstpointer a, gconstpointer b) {
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
    g_ptr_array_sort(names, by_text);
    for (guint i = 0; i < names->len; i++) {
        name = names->pdata[i];
        double tl, pl, tv, pv;
        if (*name == '.' || !import_is_picture(name)) /* “._a.jpg” of macOS is not a picture */
            continue;
        if (!find_key(name, "tl", &tl) || !find_key(name, "pl", &pl) ||
            !find_key(name, "tv", &tv) || !find_key(name, "pv", &pv))
            return data_error_fail(
                folder, 0, error,
                "the name “%s” does not contain its directions; it needs tl, pl, tv and pv, each "
                "once and followed by 0 to 360 degrees, as in “tl030 pl090 tv000 pv000.jpg”",
                name);
        struct named *named = g_new0(struct named, 1);
        *named = (struct named){g_build_filename(folder, name, NULL),
                                import_names_direction(tv, pv), import_names_direction(tl, pl), 0};
        g_ptr_array_add(pictures->all, named);
    }
    return pictures->all->len > 0 ||
           data_error_fail(folder, 0, error,
                           "the folder has no picture (JPEG, PNG, TIFF, EXR or camera raw); give "
                           "the folder that contains the pictures");
}

static int by_number(gconstpointer a, gconstpointer b) {
    return strverscmp(*(char *const *)a, *(char *const *)b);
}

/* Returns the path of a picture that a list names; g_free(). The name may be a path on another
 * machine, with slashes or backslashes. Returns that path below the list's folder if the path is
 * relative and the file exists. Otherwise returns the path of a picture directly in the list's
 * folder. */
static char *find_picture(const char *folder, const char *name) {
    g_autofree char *plain = g_strdelimit(g_strdup(name), "\\", '/');
    g_autofree char *base = g_path_get_basename(plain);
    g_autofree char *below = g_build_filename(folder, plain, NULL);
    if (!g_path_is_absolute(plain) && g_file_test(below, G_FILE_TEST_IS_REGULAR))
        return g_steal_pointer(&below);
    return g_build_filename(folder, base, NULL);
}

/* Gives the last number in a name, without the extension, and its number of digits. Of a longer
 * number, only the last nine digits are read. Returns FALSE if the name has no number. */
static gboolean counter_of(const char *name, gint64 *ret, int *ret_digits) {
    const char *end = strrchr(name, '.');
    end = end ? end : name + strlen(name);
    while (end > name && !g_ascii_isdigit(end[-1]))
        end--;
    const char *begin = end;
    while (begin > name && g_ascii_isdigit(begin[-1]) && end - begin < 9)
        begin--;
    *ret = g_ascii_strtoll(begin, NULL, 10);
    *ret_digits = (int)(end - begin);
    return end > begin;
}

/* Returns whether a camera's counter has begun again at 0 within these sorted names. The function
 * assumes so if the first number is near 0, the last number is near the largest number with this
 * many digits, and numbers between them are missing. */
static gboolean counter_wrapped(const GPtrArray *names) {
    gint64 first = 0, last = 0, gap = 0;
    int digits = 0;
    for (guint i = 0; i < names->len; i++) {
        gint64 number;
        int its;
        if (!counter_of(names->pdata[i], &number, &its) || (i > 0 && its != digits) || its < 3)
            return FALSE;
        gap = i > 0 ? MAX(gap, number - last) : 0;
        first = i > 0 ? first : number;
        last = number;
        digits = its;
    }
    const gint64 margin = (gint64)names->len + 10;
    return gap > margin && first < margin && last > (gint64)pow(10, digits) - margin;
}

struct taken {
    char *name;
    gint64 us;
    guint order; /* rank in the order of names */
};

static int by_time(gconstpointer a, gconstpointer b) {
    const struct taken *x = a, *y = b;
    return x->us != y->us ? (x->us < y->us ? -1 : 1)
                          : (x->order > y->order) - (x->order < y->order);
}

/* Sorts pictures by the time at which they were taken, if all files state this time. Otherwise
 * leaves them sorted by name, and fails if a camera's counter has begun again within the names. */
static gboolean order_by_time(const char *list, const char *folder, GPtrArray *names,
                              GPtrArray *notes, GError **error) {
    g_autofree struct taken *taken = g_new0(struct taken, MAX(names->len, 1));
    gboolean all = TRUE, differs = FALSE;
    for (guint i = 0; i < names->len; i++) {
        g_autofree char *path = g_build_filename(folder, names->pdata[i], NULL);
        struct picture_says says;
        picture_says_read_file(path, &says);
        taken[i] = (struct taken){names->pdata[i], says.taken_us, i};
        all &= says.taken_us != 0;
        picture_says_clear(&says);
    }
    if (!all)
        return !counter_wrapped(names) ||
               data_error_fail(
                   list, 0, error,
                   "the names of the pictures next to this list go from %s to %s with a gap, as if "
                   "the camera's counter had begun again, and not all pictures state when they "
                   "were taken; write a picture's name before each direction",
                   (const char *)names->pdata[0], (const char *)names->pdata[names->len - 1]);
    qsort(taken, names->len, sizeof *taken, by_time);
    for (guint i = 0; i < names->len; i++) {
        differs |= names->pdata[i] != taken[i].name;
        names->pdata[i] = taken[i].name;
    }
    if (differs && notes)
        g_ptr_array_add(notes, g_strdup_printf("the pictures are sorted by their times in EXIF, "
                                               "from %s to %s; the order of their names differs",
                                               (const char *)names->pdata[0],
                                               (const char *)names->pdata[names->len - 1]));
    return TRUE;
}

/* Returns the names of n pictures for a list without names. The names are the lines of
 * "filenames.txt" next to the list. If there is no such file, they are all pictures next to the
 * list, sorted by time or by name. "9.png" is before "10.png". Returns NULL with an error if their
 * number is not n, or if their order is not certain (order_by_time()). */
static GPtrArray *names_beside(const struct pictures *pictures, const char *list,
                               const char *folder, guint n, GError **error) {
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
        g_auto(GStrv) lines = text_table_lines(text);
        for (char **line = lines; *line; line++)
            if (*g_strstrip(*line))
                g_ptr_array_add(names, g_strdup(*line));
    } else {
        g_autoptr(GDir) dir = g_dir_open(folder, 0, error);
        if (!dir)
            return NULL;
        for (const char *name; (name = g_dir_read_name(dir));)
            if (*name != '.' && import_is_picture(name))
                g_ptr_array_add(names, g_strdup(name));
        g_ptr_array_sort(names, by_number);
    }
    if (names->len == n)
        return listed || order_by_time(list, folder, names, pictures->wish->notes, error)
                   ? g_steal_pointer(&names)
                   : NULL;
    data_error_set(list, 0, error,
                   "the list has %u directions without names of pictures, but %s has %u "
                   "pictures%s%s; %s, or write a picture's name before each direction",
                   n, listed ? other : folder, names->len, names->len ? ", the last one " : "",
                   names->len ? (const char *)names->pdata[names->len - 1] : "",
                   names->len > n ? "remove the pictures that do not belong to the list"
                                  : "add the missing pictures");
    return NULL;
}

static void tell_horizon(const struct pictures *pictures, const char *list,
                         const struct import_light *light, const char *path) {
    if (pictures->wish->notes)
        g_ptr_array_add(pictures->wish->notes,
                        g_strdup_printf("%s:%d: %s is left out, because its light is on the "
                                        "horizon and does not reach the sample",
                                        list, light->line, path));
}

/* Takes the position of a lamp from the list, or at a distance in the direction of its light. */
static void place(struct named *named, const struct import_light *light, double distance_mm) {
    const double theta = light->theta_deg * G_PI / 180, phi = light->phi_deg * G_PI / 180;
    named->placed = light->placed || distance_mm > 0;
    named->position_mm =
        light->placed ? light->position_mm
                      : vec3_scale(vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)),
                                   distance_mm);
    named->exponent = light->placed ? light->exponent : 0;
}

static gboolean read_list(struct pictures *pictures, const char *list, GError **error) {
    g_autoptr(GArray) lights = import_lights_read(list, error);
    g_autofree char *folder = g_path_get_dirname(list);
    g_autoptr(GPtrArray) names = NULL;
    if (!lights)
        return FALSE;
    if (!g_array_index(lights, struct import_light, 0).name &&
        !(names = names_beside(pictures, list, folder, lights->len, error)))
        return FALSE;
    for (guint i = 0; i < lights->len; i++) {
        const struct import_light *light = &g_array_index(lights, struct import_light, i);
        g_autofree char *path = find_picture(folder, names ? names->pdata[i] : light->name);
        if (!g_file_test(path, G_FILE_TEST_IS_REGULAR))
            return data_error_fail(
                list, light->line, error,
                "there is no picture %s; correct the name in the list, or copy the picture there",
                path);
        if (light->on_horizon) {
            tell_horizon(pictures, list, light, path);
            continue;
        }
        struct named *named = g_new0(struct named, 1);
        named->path = g_steal_pointer(&path);
        named->line = light->line;
        named->light = import_names_direction(light->theta_deg, light->phi_deg);
        place(named, light, pictures->wish->lamp_mm);
        g_ptr_array_add(pictures->all, named);
    }
    return TRUE;
}

/* Returns whether a file may have masked pixels or values that are not numbers. Such files are EXR,
 * TIFF, and PNG with opacity. */
static gboolean may_have_holes(const char *path) {
    const char *dot = strrchr(path, '.');
    if (dot && (g_ascii_strcasecmp(dot, ".exr") == 0 || g_ascii_strcasecmp(dot, ".tif") == 0 ||
                g_ascii_strcasecmp(dot, ".tiff") == 0))
        return TRUE;
    struct picture_says says = {0};
    if (dot && g_ascii_strcasecmp(dot, ".png") == 0)
        picture_says_read_file(path, &says);
    picture_says_clear(&says);
    return says.alpha;
}

/* Divides a picture by the irradiance of its lamp on planes that face it. At the distance r from
 * the lamp and the angle α from its aim, which is the middle of the texels, values are multiplied
 * by r² / (R² cosⁿ α). R² is the mean of r² in the middle over all lamps, which are taken as
 * equally bright. */
static void divide_by_irradiance(const struct pictures *pictures, const struct named *named,
                                 const struct import_region *region, float *const *planes) {
    const double r0 = vec3_length(named->position_mm);
    for (int i = 0; i < region->width * region->height; i++) {
        const struct vec3 way =
            vec3((i % region->width + 0.5 - 0.5 * region->width) * pictures->texel_mm -
                     named->position_mm.x,
                 (0.5 * region->height - 0.5 - (int)(i / region->width)) * pictures->texel_mm -
                     named->position_mm.y,
                 -named->position_mm.z);
        const double square = vec3_dot(way, way);
        const double cosine = -vec3_dot(way, named->position_mm) / (sqrt(square) * r0);
        const double factor =
            cosine > 0 ? square / (pictures->square_mm * pow(cosine, named->exponent)) : 0;
        for (int c = 0; c < 3; c++)
            planes[c][i] *= (float)factor;
    }
}

static gboolean give_picture(int view, int light, const struct import_region *region,
                             float *const *ret_planes, int *ret_holes, gpointer data,
                             GError **error) {
    const struct pictures *pictures = data;
    struct named *named = pictures->of->pdata[(guint)view * pictures->lights->len + (guint)light];
    const gsize n = (gsize)region->width * (gsize)region->height;
    *ret_holes = 0;
    if (!ret_planes && !may_have_holes(named->path))
        return TRUE;
    g_autoptr(ImportPicture) picture =
        import_picture_read_part(named->path, region, pictures->wish->transfer, error);
    if (!picture || !import_picture_check_same(
                        pictures->first, picture, named->line ? pictures->source : named->path,
                        named->line, named->line ? named->path : "it", error))
        return FALSE;
    for (gsize i = 0; i < n; i++) {
        const gsize x = (gsize)region->x + i % (gsize)region->width;
        const gsize y = (gsize)region->y + i / (gsize)region->width;
        const float *from =
            picture->rgb + 3 * ((y - (gsize)picture->part.y) * (gsize)picture->part.width + x -
                                (gsize)picture->part.x);
        const gboolean good = isfinite(from[0]) && isfinite(from[1]) && isfinite(from[2]);
        for (int c = 0; ret_planes && c < 3; c++)
            ret_planes[c][i] = good ? from[c] : 0;
        if (ret_planes && ret_planes[3] && !good)
            ret_planes[3][i] = BTF_FLAG_HOLE;
        *ret_holes += !good;
    }
    if (ret_planes && !named->counted) {
        named->counted = TRUE;
        import_look_count(pictures->look, picture);
        for (gsize i = 0; ret_planes[3] && i < n; i++)
            ret_planes[0][i] = ret_planes[3][i] > 0 ? NAN : ret_planes[0][i];
        import_look_add(pictures->look, view, light, (const float *const *)ret_planes, 1, n, 1);
        for (gsize i = 0; ret_planes[3] && i < n; i++)
            ret_planes[0][i] = ret_planes[3][i] > 0 ? 0 : ret_planes[0][i];
    }
    if (ret_planes && named->placed)
        divide_by_irradiance(pictures, named, region, ret_planes);
    return import_picture_check_holes(picture, (gsize)*ret_holes, n, named->path, 0, NULL, error);
}

/* Adds the position of the lamp to a part. */
static const guint8 *give_light(int view, int light, struct exr_part *part, gpointer data) {
    const struct pictures *pictures = data;
    const struct named *named =
        pictures->of->pdata[(guint)view * pictures->lights->len + (guint)light];
    const struct vec3 p = named->position_mm;
    if (named->placed) {
        exr_set_v3d(part, "light.position_mm", p.x, p.y, p.z);
        exr_set_v3d(part, "light.aim", -p.x, -p.y, -p.z);
        exr_set_double(part, "light.exponent", named->exponent);
    }
    return NULL;
}

static void degrees(const GArray *directions, float **ret_theta_deg, float **ret_phi_deg) {
    *ret_theta_deg = g_new(float, directions->len);
    *ret_phi_deg = g_new(float, directions->len);
    for (guint i = 0; i < directions->len; i++) {
        const struct direction *d = &g_array_index(directions, struct direction, i);
        (*ret_theta_deg)[i] = (float)((double)d->theta / STEPS_A_DEG);
        (*ret_phi_deg)[i] = (float)((double)d->phi / STEPS_A_DEG);
    }
}

static gboolean filled(Session *session, gpointer data, GError **error) {
    const struct pictures *pictures = data;
    return import_look_tell(pictures->look, session, pictures->wish->notes, error);
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
        .source = source, .all = all, .views = views, .lights = lights, .of = of, .wish = wish};
    if (!read_names(&pictures, source, error) || !arrange(&pictures, error))
        return FALSE;
    const struct named *named = all->pdata[0];
    /* Only the size of the first picture is needed here. The picture may be too large to be read as
     * a whole. */
    const struct import_region corner = {0, 0, 1, 1};
    g_autoptr(ImportPicture) first = import_picture_read_part(
        named->path, wish->region.width > 0 ? &corner : NULL, wish->transfer, error);
    if (!first) {
        int width = 0, height = 0;
        if (error && *error && wish->region.width == 0 &&
            picture_part_can(named->path, &width, &height) && height > INPUT_FILE_PIXELS / width) {
            g_autofree char *why = g_steal_pointer(&(*error)->message);
            (*error)->message =
                g_strconcat(why, "; or import only a part with --region X,Y,WIDTH,HEIGHT", NULL);
        }
        return FALSE;
    }
    pictures.first = first;
    g_clear_pointer(&first->rgb, g_free);
    degrees(views, &view_theta, &view_phi);
    degrees(lights, &light_theta, &light_phi);
    const struct import_material material = {
        .source = source,
        .width = first->width,
        .height = first->height,
        .texel_mm = wish->texel_mm > 0 ? wish->texel_mm : 1,
        .region = wish->region,
        .n_views = (int)views->len,
        .n_lights = (int)lights->len,
        .view_theta_deg = view_theta,
        .view_phi_deg = view_phi,
        .light_theta_deg = light_theta,
        .light_phi_deg = light_phi,
        .picture = give_picture,
        .light = give_light,
        .filled = filled,
        .data = &pictures,
    };
    pictures.texel_mm = material.texel_mm;
    for (guint i = 0; i < all->len; i++) {
        const struct named *each = all->pdata[i];
        pictures.square_mm += vec3_dot(each->position_mm, each->position_mm) / all->len;
    }
    int steepest = 0;
    for (int v = 1; v < (int)views->len; v++)
        steepest = view_theta[v] < view_theta[steepest] ? v : steepest;
    pictures.look = import_look_new(wish->transfer, (int)views->len, (int)lights->len, light_theta,
                                    light_phi, steepest);
    const gboolean ok = import_material(path, &material, work, ret, error);
    import_look_free(pictures.look);
    return ok;
}

gboolean import_pictures(const char *path, const char *folder, const struct import_wish *wish,
                         const struct work *work, struct import_result *ret, GError **error) {
    return import_named(path, folder, list_folder, wish, work, ret, error);
}

gboolean import_rti(const char *path, const char *list, const struct import_wish *wish,
                    const struct work *work, struct import_result *ret, GError **error) {
    return import_named(path, list, read_list, wish, work, ret, error);
}
