#include "unfinished.h"

#include <glib/gstdio.h>
#include <string.h>
#include <xxhash.h>

#include "exr.h"

#define PERIOD_US (20 * G_USEC_PER_SEC)
#define HEAD      "unfinished"
#define WORD      sizeof(float)
#define WIDTH     4096 /* pixels of a line */
#define SHARE     20   /* of the time goes into work for one that goes into keeping it */

struct array {
    char *name;
    gconstpointer values; /* borrowed; or NULL: flags */
    const int *flags;
    gsize size; /* bytes */
};

struct Unfinished {
    char *path, *inputs, *note;
    GPtrArray *kept;   /* of struct array */
    GHashTable *found; /* name → GBytes */
    gint64 period_us, saved_us, took_us;
    gboolean own; /* the file that is there is of this work */
};

static void free_array(gpointer data) {
    struct array *array = data;
    g_free(array->name);
    g_free(array);
}

Unfinished *unfinished_new(const char *path) {
    Unfinished *unfinished = g_new0(Unfinished, 1);
    unfinished->path = g_strdup(path);
    unfinished->kept = g_ptr_array_new_with_free_func(free_array);
    unfinished->found =
        g_hash_table_new_full(g_str_hash, g_str_equal, g_free, (GDestroyNotify)g_bytes_unref);
    unfinished->period_us = PERIOD_US;
    return unfinished;
}

void unfinished_free(Unfinished *unfinished) {
    if (!unfinished)
        return;
    g_ptr_array_unref(unfinished->kept);
    g_hash_table_unref(unfinished->found);
    g_free(unfinished->path);
    g_free(unfinished->inputs);
    g_free(unfinished->note);
    g_free(unfinished);
}

void unfinished_set_period(Unfinished *unfinished, double seconds) {
    unfinished->period_us = (gint64)(seconds * G_USEC_PER_SEC);
}

const char *unfinished_note(const Unfinished *unfinished) {
    return unfinished->note;
}

/* Pixels of four bytes, the last ones 0. NULL: more than a file takes. */
static struct exr_part *to_part(const char *name, gconstpointer values, gsize size) {
    static const char *const bits[] = {"BITS", NULL};
    const gsize words = MAX((size + WORD - 1) / WORD, 1), width = MIN(words, WIDTH);
    const gsize height = (words + width - 1) / width;
    if (height > EXR_MAX_PIXELS / WIDTH)
        return NULL;
    struct exr_part *part = exr_part_new(name, (int)width, (int)height, bits, EXR_FLOAT);
    g_autofree char *bytes = g_strdup_printf("%" G_GSIZE_FORMAT, size);
    g_autofree char *hash =
        g_strdup_printf("%016" G_GINT64_MODIFIER "x", (guint64)XXH3_64bits(values, size));
    memcpy(part->planes[0], values, size);
    exr_set_string(part, "mesorig.bytes", bytes);
    exr_set_string(part, "mesorig.hash", hash);
    return part;
}

/* What flags say is done was so before it is copied. */
static struct exr_part *array_part(const struct array *array) {
    if (array->values)
        return to_part(array->name, array->values, array->size);
    const gsize n = array->size / sizeof(int);
    g_autofree int *flags = g_new(int, n);
    for (gsize i = 0; i < n; i++)
        flags[i] = g_atomic_int_get(&array->flags[i]);
    return to_part(array->name, flags, array->size);
}

/* NULL: it is damaged. */
static GBytes *from_part(const struct exr_part *part) {
    const float *plane = exr_part_plane(part, "BITS");
    const char *bytes = NULL, *hash = NULL;
    guint64 size = 0;
    if (!plane || !exr_get_string(part, "mesorig.bytes", &bytes, NULL) ||
        !exr_get_string(part, "mesorig.hash", &hash, NULL) ||
        !g_ascii_string_to_unsigned(
            bytes, 10, 0, WORD * (guint64)part->width * (guint64)part->height, &size, NULL))
        return NULL;
    g_autofree char *is =
        g_strdup_printf("%016" G_GINT64_MODIFIER "x", (guint64)XXH3_64bits(plane, size));
    return strcmp(is, hash) == 0 ? g_bytes_new(plane, size) : NULL;
}

/* What is wrong with the file, or NULL. */
static const char *take(Unfinished *unfinished, const struct exr_file *file) {
    const struct exr_part *head = exr_file_part(file, HEAD);
    const char *of = NULL, *kind = NULL;
    if (!head || !exr_get_string(head, "mesorig.kind", &kind, NULL) || strcmp(kind, HEAD) != 0 ||
        !exr_get_string(head, "mesorig.inputs", &of, NULL))
        return "is not what unfinished work leaves";
    if (strcmp(of, unfinished->inputs) != 0)
        return "is of another BTF, of other options or of another version";
    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = file->parts->pdata[i];
        GBytes *bytes = from_part(part);
        if (!bytes)
            return "is damaged";
        g_hash_table_insert(unfinished->found, g_strdup(part->name), bytes);
    }
    return NULL;
}

static void hash_values(XXH3_state_t *state, const struct btf_matrix *btf) {
    const gsize row = sizeof(float) * (gsize)btf->n_views * (gsize)btf->n_lights * 3;
    if (btf->values) {
        XXH3_128bits_update(state, btf->values, row * (gsize)btf->width * (gsize)btf->height);
        return;
    }
    for (int view = 0; view < btf->n_views; view++) {
        const guint64 hash = btf_scratch_hash(btf->scratch, view);
        XXH3_128bits_update(state, &hash, sizeof hash);
    }
}

static char *hash_inputs(const struct btf_matrix *btf, const char *what) {
    XXH3_state_t *state = XXH3_createState();
    const float *const angles[] = {btf->view_theta_deg, btf->view_phi_deg, btf->light_theta_deg,
                                   btf->light_phi_deg};
    g_autofree char *head =
        g_strdup_printf("%s, %d × %d × %d × %d, %s", what, btf->width, btf->height, btf->n_views,
                        btf->n_lights, MESORIG_VERSION);
    XXH3_128bits_reset(state);
    XXH3_128bits_update(state, head, strlen(head));
    for (int i = 0; i < 4; i++)
        XXH3_128bits_update(state, angles[i],
                            sizeof(float) * (gsize)(i < 2 ? btf->n_views : btf->n_lights));
    hash_values(state, btf);
    const XXH128_hash_t hash = XXH3_128bits_digest(state);
    XXH3_freeState(state);
    return g_strdup_printf("%016" G_GINT64_MODIFIER "x%016" G_GINT64_MODIFIER "x",
                           (guint64)hash.high64, (guint64)hash.low64);
}

void unfinished_begin(Unfinished *unfinished, const struct btf_matrix *btf, const char *what) {
    if (unfinished->inputs)
        return;
    unfinished->inputs = hash_inputs(btf, what);
    unfinished->saved_us = g_get_monotonic_time();
    if (!g_file_test(unfinished->path, G_FILE_TEST_EXISTS))
        return;
    g_autoptr(GError) error = NULL;
    struct exr_file *file = exr_read(unfinished->path, &error);
    const char *wrong = file ? take(unfinished, file) : error->message;
    exr_file_free(file);
    unfinished->own = wrong == NULL;
    if (wrong)
        g_hash_table_remove_all(unfinished->found);
    if (error)
        unfinished->note = g_strdup_printf("%s; everything is done anew", error->message);
    else if (wrong)
        unfinished->note =
            g_strdup_printf("%s %s; everything is done anew", unfinished->path, wrong);
    else
        unfinished->note = g_strdup_printf("going on with what %s has", unfinished->path);
}

gconstpointer unfinished_get(const Unfinished *unfinished, const char *name, gsize size) {
    GBytes *bytes = g_hash_table_lookup(unfinished->found, name);
    return bytes && g_bytes_get_size(bytes) == size ? g_bytes_get_data(bytes, NULL) : NULL;
}

static void keep(Unfinished *unfinished, const char *name, struct array is) {
    struct array *array = NULL;
    g_hash_table_remove(unfinished->found, name);
    for (guint i = 0; !array && i < unfinished->kept->len; i++) {
        array = unfinished->kept->pdata[i];
        if (strcmp(array->name, name) != 0)
            array = NULL;
    }
    if (!array) {
        array = g_new0(struct array, 1);
        g_ptr_array_add(unfinished->kept, array);
    }
    g_free(array->name);
    *array = is;
    array->name = g_strdup(name);
}

void unfinished_keep(Unfinished *unfinished, const char *name, gconstpointer values, gsize size) {
    keep(unfinished, name, (struct array){.values = values, .size = size});
}

void unfinished_keep_flags(Unfinished *unfinished, const char *name, const int *flags, int n) {
    keep(unfinished, name, (struct array){.flags = flags, .size = sizeof(int) * (gsize)n});
}

void unfinished_drop(Unfinished *unfinished, const char *name) {
    for (guint i = unfinished->kept->len; i-- > 0;) {
        const struct array *array = unfinished->kept->pdata[i];
        if (!name || strcmp(array->name, name) == 0)
            g_ptr_array_remove_index(unfinished->kept, i);
    }
    if (name)
        g_hash_table_remove(unfinished->found, name);
    else
        g_hash_table_remove_all(unfinished->found);
}

/* FALSE: one of them is more than a file takes. */
static gboolean add_arrays(struct exr_file *file, const GPtrArray *kept, gboolean flags) {
    for (guint i = 0; i < kept->len; i++) {
        const struct array *array = kept->pdata[i];
        struct exr_part *part = (array->flags != NULL) == flags ? array_part(array) : NULL;
        if (part)
            exr_file_add(file, part);
        else if ((array->flags != NULL) == flags)
            return FALSE;
    }
    return TRUE;
}

/* Flags come first: what is written after they were copied does not count as done. */
static struct exr_file *to_file(const Unfinished *unfinished) {
    struct exr_file *file = exr_file_new();
    struct exr_part *head = to_part(HEAD, "", 0);
    exr_set_string(head, "mesorig.kind", HEAD);
    exr_set_string(head, "mesorig.inputs", unfinished->inputs);
    exr_file_add(file, head);
    if (add_arrays(file, unfinished->kept, TRUE) && add_arrays(file, unfinished->kept, FALSE))
        return file;
    exr_file_free(file);
    return NULL;
}

void unfinished_save(Unfinished *unfinished) {
    const gint64 begun_us = g_get_monotonic_time();
    if (!unfinished->inputs || unfinished->kept->len == 0)
        return;
    struct exr_file *file = to_file(unfinished);
    if (file && exr_write(unfinished->path, file, EXR_NONE, TRUE, NULL))
        unfinished->own = TRUE;
    exr_file_free(file);
    unfinished->saved_us = g_get_monotonic_time();
    unfinished->took_us = unfinished->saved_us - begun_us;
}

void unfinished_save_if_due(Unfinished *unfinished) {
    const gint64 since_us = g_get_monotonic_time() - unfinished->saved_us;
    /* Where it takes long it is done less often. */
    if (since_us >= unfinished->period_us &&
        (unfinished->period_us == 0 || since_us > SHARE * unfinished->took_us))
        unfinished_save(unfinished);
}

void unfinished_remove(Unfinished *unfinished) {
    unfinished_drop(unfinished, NULL);
    g_unlink(unfinished->path);
}

void unfinished_discard(Unfinished *unfinished) {
    if (unfinished->own)
        unfinished_remove(unfinished);
}
