/* Parses and writes signature, metadata and sampling of a ".btf". Angles are radians in the file,
 * degrees in memory. */
#include "bonn_private.h"

#include <math.h>
#include <string.h>

#include "base/input_file.h"

#define MAX_TEXELS     8192 /* maximum number of texels along a side, as for captured sessions */
#define MAX_DIRECTIONS 65536
#define TEXT           80
#define SAME_RAD       1e-4f /* maximum difference of the angles of a light between two views */

G_DEFINE_QUARK(bonn_error, bonn_error)

static const char *const kind_names[] = {"bdi", "sparse", "fmf", "dfmf"};

const char *bonn_kind_name(enum bonn_kind kind) {
    return kind_names[kind];
}

gboolean bonn_kind_parse(const char *name, enum bonn_kind *ret) {
    for (guint i = 0; i < G_N_ELEMENTS(kind_names); i++)
        if (strcmp(name, kind_names[i]) == 0) {
            *ret = (enum bonn_kind)i;
            return TRUE;
        }
    return FALSE;
}

void bonn_header_clear(struct bonn_header *header) {
    g_free(header->setup);
    g_free(header->sensor);
    g_free(header->light_source);
    g_free(header->xml);
    g_free(header->view_theta_deg);
    g_free(header->view_phi_deg);
    g_free(header->light_theta_deg);
    g_free(header->light_phi_deg);
    *header = (struct bonn_header){0};
}

void bonn_report(const struct bonn_bytes *bytes, enum bonn_error code, GError **error,
                 const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *message = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_set_error(error, BONN_ERROR, (int)code, "%s: %s", bytes->path, message);
}

static gboolean check_left(const struct bonn_bytes *bytes, gsize n, const char *what,
                           GError **error) {
    return n <= bytes->size - bytes->at ||
           bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                     "the file is cut off: the %s needs %zu bytes from byte %zu on, but the file "
                     "has %zu; copy it again",
                     what, n, bytes->at, bytes->size);
}

gboolean bonn_skip(struct bonn_bytes *bytes, gsize n, const char *what, GError **error) {
    if (!check_left(bytes, n, what, error))
        return FALSE;
    bytes->at += n;
    return TRUE;
}

gboolean bonn_take(struct bonn_bytes *bytes, gsize n, const char *what, gpointer ret,
                   GError **error) {
    GError *found = NULL;
    if (!check_left(bytes, n, what, error))
        return FALSE;
    if (!input_file_read_at(bytes->fd, bytes->path, ret, n, bytes->at, &found)) {
        input_file_propagate(found, BONN_ERROR, BONN_ERROR_IO, BONN_ERROR_FORMAT, error);
        return FALSE;
    }
    bytes->at += n;
    return TRUE;
}

gboolean bonn_take_u32(struct bonn_bytes *bytes, const char *what, guint32 *ret, GError **error) {
    if (!bonn_take(bytes, sizeof *ret, what, ret, error))
        return FALSE;
    *ret = GUINT32_FROM_LE(*ret);
    return TRUE;
}

static gboolean take_floats(struct bonn_bytes *bytes, const char *what, float *ret, gsize n,
                            GError **error) {
    if (!bonn_take(bytes, n * sizeof *ret, what, ret, error))
        return FALSE;
    for (gsize i = 0; i < n; i++) {
        guint32 bits;
        memcpy(&bits, &ret[i], sizeof bits);
        bits = GUINT32_FROM_LE(bits);
        memcpy(&ret[i], &bits, sizeof bits);
        if (!isfinite(ret[i]))
            return bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                             "a number in the %s is not finite; copy the file again", what);
    }
    return TRUE;
}

/* Returns the text up to the first 0, but at most n bytes, as valid UTF-8. g_free() */
static char *bonn_header_text_of(const char *at, gsize n) {
    return g_utf8_make_valid(at, (gssize)strnlen(at, n));
}

static gboolean take_text(struct bonn_bytes *bytes, const char *what, char **ret, GError **error) {
    guint32 length;
    if (!bonn_take_u32(bytes, what, &length, error) || !check_left(bytes, length, what, error))
        return FALSE;
    g_autofree char *text = g_try_malloc((gsize)length + 1);
    if (!text)
        return bonn_fail(bytes, BONN_ERROR_IO, error,
                         "there is no memory for the %u bytes of the %s; copy the file again if "
                         "this number is too large",
                         length, what);
    if (!bonn_take(bytes, length, what, text, error))
        return FALSE;
    *ret = bonn_header_text_of(text, length);
    return TRUE;
}

/* Sets ret_order, the positions of R, G, B, by the channels' names. Channels with other names are
 * assumed to be in the order R, G, B. */
static gboolean take_channels(struct bonn_bytes *bytes, int ret_order[BONN_CHANNELS],
                              GError **error) {
    static const char rgb[] = "RGB";
    int order[BONN_CHANNELS] = {-1, -1, -1};
    guint32 n;
    if (!bonn_take_u32(bytes, "number of channels", &n, error))
        return FALSE;
    if (n != BONN_CHANNELS)
        return bonn_fail(bytes, BONN_ERROR_UNSUPPORTED, error,
                         "the BTF has %u channels; only BTFs of R, G and B can be read", n);
    for (int i = 0; i < BONN_CHANNELS; i++) {
        g_autofree char *name = NULL;
        if (!take_text(bytes, "channel's name", &name, error))
            return FALSE;
        const char *found = name[0] ? strchr(rgb, g_ascii_toupper(name[0])) : NULL;
        if (found)
            order[found - rgb] = i;
    }
    if (order[0] >= 0 && order[1] >= 0 && order[2] >= 0)
        memcpy(ret_order, order, sizeof order);
    return TRUE;
}

static gboolean take_metadata(struct bonn_bytes *bytes, struct bonn_header *ret,
                              int ret_order[BONN_CHANNELS], GError **error) {
    const gsize begin = bytes->at;
    guint32 size, version, cosine = 0;
    char texts[3 * TEXT];
    float numbers[4];
    if (!bonn_take_u32(bytes, "metadata", &size, error) ||
        !bonn_take_u32(bytes, "metadata", &version, error) ||
        !bonn_take(bytes, sizeof texts, "metadata", texts, error) ||
        !take_floats(bytes, "metadata", numbers, 4, error) ||
        (version > 1 && !bonn_take_u32(bytes, "metadata", &cosine, error)) ||
        (version > 2 && !take_text(bytes, "metadata", &ret->xml, error)) ||
        (version > 3 && !take_channels(bytes, ret_order, error)))
        return FALSE;
    ret->setup = bonn_header_text_of(texts, TEXT);
    ret->sensor = bonn_header_text_of(texts + TEXT, TEXT);
    ret->light_source = bonn_header_text_of(texts + 2 * TEXT, TEXT);
    ret->texels_a_mm = (double)numbers[0];
    for (int i = 0; i < BONN_CHANNELS; i++)
        ret->rgb_scale[i] = (double)numbers[i + 1];
    ret->cosine = cosine != 0;
    return bytes->at - begin == size ||
           bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                     "the metadata should have %u bytes, but has %zu; copy the file again", size,
                     bytes->at - begin);
}

static gboolean take_count(struct bonn_bytes *bytes, const char *what, guint32 most, gsize each,
                           guint32 *ret, GError **error) {
    if (!bonn_take_u32(bytes, what, ret, error))
        return FALSE;
    if (*ret < 1 || *ret > most)
        return bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                         "the %s is %u, but must be from 1 to %u; copy the file again", what, *ret,
                         most);
    return *ret <= (bytes->size - bytes->at) / MAX(each, 1) || each == 0 ||
           bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                     "the file is cut off: the %s is %u, for which its %zu bytes are too few; copy "
                     "it again",
                     what, *ret, bytes->size);
}

static float bonn_header_degrees(float rad) {
    return (float)((double)rad * 180 / G_PI);
}

/* Reads θ and φ of each light. All views must have the lights of the first view. */
static gboolean bonn_header_take_lights(struct bonn_bytes *bytes, struct bonn_header *ret,
                                        float **first, guint32 view, GError **error) {
    guint32 n;
    if (!take_count(bytes, "number of lights", MAX_DIRECTIONS, 8, &n, error))
        return FALSE;
    g_autofree float *lights = g_new(float, 2 * (gsize)n);
    if (!take_floats(bytes, "list of lights", lights, 2 * (gsize)n, error))
        return FALSE;
    if (!*first) {
        *first = g_steal_pointer(&lights);
        ret->n_lights = (int)n;
        return TRUE;
    }
    gboolean same = (int)n == ret->n_lights;
    for (guint32 i = 0; same && i < 2 * n; i++)
        same = fabsf(lights[i] - (*first)[i]) < SAME_RAD;
    return same ||
           bonn_fail(
               bytes, BONN_ERROR_UNSUPPORTED, error,
               "the lights of view %u differ from those of view 0; such a file cannot be read",
               view);
}

static gboolean take_sampling(struct bonn_bytes *bytes, struct bonn_header *ret, GError **error) {
    guint32 n;
    g_autofree float *lights = NULL;
    if (!take_count(bytes, "number of views", MAX_DIRECTIONS, 12, &n, error))
        return FALSE;
    ret->n_views = (int)n;
    ret->view_theta_deg = g_new(float, n);
    ret->view_phi_deg = g_new(float, n);
    for (guint32 i = 0; i < n; i++) {
        float view[2];
        if (!take_floats(bytes, "list of views", view, 2, error) ||
            !bonn_header_take_lights(bytes, ret, &lights, i, error))
            return FALSE;
        ret->view_theta_deg[i] = bonn_header_degrees(view[0]);
        ret->view_phi_deg[i] = bonn_header_degrees(view[1]);
    }
    ret->light_theta_deg = g_new(float, ret->n_lights);
    ret->light_phi_deg = g_new(float, ret->n_lights);
    for (int i = 0; lights && i < ret->n_lights; i++) {
        ret->light_theta_deg[i] = bonn_header_degrees(lights[2 * i]);
        ret->light_phi_deg[i] = bonn_header_degrees(lights[2 * i + 1]);
    }
    return TRUE;
}

/* Signatures have nine or ten bytes. After a short signature, the tenth byte already belongs to the
 * metadata. Sets *ret_extra to TRUE for an FMF with a version. */
static gboolean take_signature(struct bonn_bytes *bytes, enum bonn_kind *ret, gboolean *ret_extra,
                               GError **error) {
    static const struct {
        const char *text;
        enum bonn_kind kind;
        gboolean extra;
    } known[] = {{"!BDIF06R2!", BONN_BDI, FALSE},
                 {"!BDI06R2!", BONN_BDI, FALSE},
                 {"!DFMF08FCR", BONN_DFMF, FALSE},
                 {"!FMF12FCER", BONN_FMF, TRUE},
                 {"!FMF06FCR", BONN_FMF, FALSE}};
    char begin[BONN_SIGNATURE] = {0};
    if (!bonn_take(bytes, MIN(bytes->size, sizeof begin), "signature", begin, error))
        return FALSE;
    for (gsize i = 0; i < G_N_ELEMENTS(known); i++) {
        const gsize n = strlen(known[i].text);
        if (memcmp(begin, known[i].text, n) != 0)
            continue;
        bytes->at = n;
        *ret = known[i].kind;
        *ret_extra = known[i].extra;
        return TRUE;
    }
    return bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                     "the file is not a known kind of Bonn's BTF files, which begin with "
                     "!BDIF06R2!, !BDI06R2!, !DFMF08FCR, !FMF12FCER or !FMF06FCR; give a .btf file "
                     "of that database");
}

gboolean bonn_parse_header(struct bonn_bytes *bytes, struct bonn_header *ret,
                           int ret_order[BONN_CHANNELS], gboolean *ret_extra, GError **error) {
    guint32 width, height;
    for (int i = 0; i < BONN_CHANNELS; i++)
        ret_order[i] = i;
    if (!take_signature(bytes, &ret->kind, ret_extra, error) ||
        !take_metadata(bytes, ret, ret_order, error) || !take_sampling(bytes, ret, error) ||
        !take_count(bytes, "width", MAX_TEXELS, 0, &width, error) ||
        !take_count(bytes, "height", MAX_TEXELS, 0, &height, error))
        return FALSE;
    ret->width = (int)width;
    ret->height = (int)height;
    return TRUE;
}

gboolean bonn_skip_rotations(struct bonn_bytes *bytes, struct bonn_header *header, GError **error) {
    guint32 n;
    if (!bonn_take_u32(bytes, "number of rotations", &n, error) ||
        !bonn_skip(bytes, (gsize)n * 9 * sizeof(float), "rotations", error))
        return FALSE;
    header->n_rotations = (int)MIN(n, G_MAXINT);
    return TRUE;
}

static void put_fixed(GByteArray *to, const char *text) {
    char field[TEXT] = {0};
    memcpy(field, text ? text : "", text ? MIN(strlen(text), TEXT - 1) : 0);
    g_byte_array_append(to, (const guint8 *)field, TEXT);
}

static void put_text(GByteArray *to, const char *text) {
    const gsize n = text ? strlen(text) : 0;
    bytes_put_u32(to, (guint32)n);
    g_byte_array_append(to, (const guint8 *)(text ? text : ""), (guint)n);
}

static double bonn_header_radians(float deg) {
    return (double)deg * G_PI / 180;
}

void bonn_put_header(GByteArray *to, const struct bonn_header *header) {
    static const char *const signatures[] = {"!BDIF06R2!", "!BDIF06R2!", "!FMF12FCER",
                                             "!DFMF08FCR"};
    g_byte_array_append(to, (const guint8 *)signatures[header->kind], BONN_SIGNATURE);
    bytes_put_u32(to, 0); /* size of the block, set at the end */
    bytes_put_u32(to, 4);
    put_fixed(to, header->setup);
    put_fixed(to, header->sensor);
    put_fixed(to, header->light_source);
    bytes_put_float(to, header->texels_a_mm);
    for (int i = 0; i < BONN_CHANNELS; i++)
        bytes_put_float(to, header->rgb_scale[i]);
    bytes_put_u32(to, header->cosine);
    put_text(to, header->xml);
    bytes_put_u32(to, BONN_CHANNELS);
    put_text(to, "R");
    put_text(to, "G");
    put_text(to, "B");
    const guint32 size = GUINT32_TO_LE(to->len - BONN_SIGNATURE);
    memcpy(to->data + BONN_SIGNATURE, &size, sizeof size);
    bytes_put_u32(to, (guint32)header->n_views);
    for (int v = 0; v < header->n_views; v++) {
        bytes_put_float(to, bonn_header_radians(header->view_theta_deg[v]));
        bytes_put_float(to, bonn_header_radians(header->view_phi_deg[v]));
        bytes_put_u32(to, (guint32)header->n_lights);
        for (int l = 0; l < header->n_lights; l++) {
            bytes_put_float(to, bonn_header_radians(header->light_theta_deg[l]));
            bytes_put_float(to, bonn_header_radians(header->light_phi_deg[l]));
        }
    }
    bytes_put_u32(to, (guint32)header->width);
    bytes_put_u32(to, (guint32)header->height);
}
