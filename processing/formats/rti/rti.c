#include "rti.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/output_file.h"

#define MAX_BYTES  ((gsize)2 << 30)
#define MAX_SIDE   65536
#define MAX_HEAD   4096
#define MAX_NUMBER 40

void rti_free(struct rti *rti) {
    if (!rti)
        return;
    g_free(rti->bytes);
    g_free(rti->colours);
    g_free(rti);
}

void rti_ptm_basis(const float light[3], float ret[RTI_PTM_TERMS]) {
    const float x = light[0], y = light[1];
    const float basis[RTI_PTM_TERMS] = {x * x, y * y, x * y, x, y, 1};
    memcpy(ret, basis, sizeof basis);
}

/* A file in memory. at is the number of bytes that have been read. */
struct head {
    const char *path;
    const guint8 *bytes;
    gsize n, at;
};

static gboolean is_blank(guint8 c) {
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

/* Reads the next word of the header. Returns FALSE if there is none, if it is too long, or if the
 * header has more than MAX_HEAD bytes. */
static gboolean rti_word(struct head *head, char ret[MAX_NUMBER + 1]) {
    gsize length = 0;
    while (head->at < head->n && head->at < MAX_HEAD && is_blank(head->bytes[head->at]))
        head->at++;
    while (head->at < head->n && length < MAX_NUMBER && !is_blank(head->bytes[head->at]))
        ret[length++] = (char)head->bytes[head->at++];
    ret[length] = '\0';
    return length > 0 && length < MAX_NUMBER && head->at < MAX_HEAD;
}

static gboolean rti_number(struct head *head, const char *what, double least, double most,
                           double *ret, GError **error) {
    char word[MAX_NUMBER + 1], *end;
    if (!rti_word(head, word))
        return data_error_fail(head->path, 0, error, "the header lacks the %s; copy the file again",
                               what);
    *ret = g_ascii_strtod(word, &end);
    if (*end || !(*ret >= least && *ret <= most)) {
        g_autofree char *shown = g_utf8_make_valid(word, -1);
        return data_error_fail(
            head->path, 0, error,
            "the %s in the header is %s, but must be from %g to %g; copy the file again", what,
            shown, least, most);
    }
    return TRUE;
}

/* Skips blanks and the end of the header's last line. The bytes of the texels begin there. */
static gboolean line_end(struct head *head, GError **error) {
    while (head->at < head->n && head->bytes[head->at] != '\n' && is_blank(head->bytes[head->at]))
        head->at++;
    if (head->at >= head->n || head->bytes[head->at] != '\n')
        return data_error_fail(head->path, 0, error,
                               "the file ends within the header; copy the file again");
    head->at++;
    return TRUE;
}

static gboolean take(struct head *head, void *to, gsize n, GError **error) {
    if (n > head->n - head->at)
        return data_error_fail(head->path, 0, error,
                               "the file ends %zu bytes too soon; copy it again",
                               n - (head->n - head->at));
    memcpy(to, head->bytes + head->at, n);
    head->at += n;
    return TRUE;
}

static gboolean read_size(struct head *head, struct rti *rti, GError **error) {
    double width, height;
    if (!rti_number(head, "width", 1, MAX_SIDE, &width, error) ||
        !rti_number(head, "height", 1, MAX_SIDE, &height, error))
        return FALSE;
    rti->width = (int)width;
    rti->height = (int)height;
    return TRUE;
}

/* Allocates memory for the texels. Returns FALSE with an error if the file is too short for
 * them. */
static gboolean make_bytes(const struct head *head, struct rti *rti, GError **error) {
    const gsize texels = (gsize)rti->width * (gsize)rti->height;
    const gsize each = (gsize)rti->n_terms * (rti->lrgb ? 1 : 3);
    if (texels * (each + (rti->lrgb ? 3 : 0)) > head->n - head->at)
        return data_error_fail(head->path, 0, error,
                               "the file has too few bytes for %d × %d texels; copy it again",
                               rti->width, rti->height);
    rti->bytes = g_malloc(texels * each);
    rti->colours = rti->lrgb ? g_malloc(texels * 3) : NULL;
    return TRUE;
}

static gboolean read_ptm(struct head *head, struct rti *rti, GError **error) {
    char version[MAX_NUMBER + 1], format[MAX_NUMBER + 1];
    if (!rti_word(head, version) || !rti_word(head, format))
        return data_error_fail(head->path, 0, error,
                               "the header lacks the format; copy the file again");
    g_autofree char *shown = g_utf8_make_valid(format, -1);
    rti->lrgb = strcmp(format, "PTM_FORMAT_LRGB") == 0;
    if (!rti->lrgb && strcmp(format, "PTM_FORMAT_RGB") != 0)
        return data_error_fail(head->path, 0, error,
                               "the format is %s; only PTM_FORMAT_RGB and PTM_FORMAT_LRGB can be "
                               "read. Convert it, for instance with relight-cli",
                               shown);
    rti->n_terms = RTI_PTM_TERMS;
    if (!read_size(head, rti, error))
        return FALSE;
    for (int i = 0; i < RTI_PTM_TERMS; i++)
        if (!rti_number(head, "scale", -1e6, 1e6, &rti->scale[i], error))
            return FALSE;
    for (int i = 0; i < RTI_PTM_TERMS; i++) {
        if (!rti_number(head, "bias", -1e6, 1e6, &rti->bias[i], error))
            return FALSE;
        rti->scale[i] /= 255;
    }
    if (!line_end(head, error) || !make_bytes(head, rti, error))
        return FALSE;
    const gsize width = (gsize)rti->width, height = (gsize)rti->height;
    const gboolean joined = rti->lrgb && strcmp(version, "PTM_1.2") != 0;
    for (gsize c = 0; c < (rti->lrgb ? 1 : 3); c++)
        for (gsize i = 0; i < width * height; i++) {
            const gsize texel = (height - 1 - i / width) * width + i % width;
            guint8 *to = rti->bytes + (rti->lrgb ? texel : 3 * texel + c) * RTI_PTM_TERMS;
            if (!take(head, to, RTI_PTM_TERMS, error) ||
                (joined && !take(head, rti->colours + 3 * texel, 3, error)))
                return FALSE;
        }
    for (gsize i = 0; rti->lrgb && !joined && i < width * height; i++) {
        const gsize texel = (height - 1 - i / width) * width + i % width;
        if (!take(head, rti->colours + 3 * texel, 3, error))
            return FALSE;
    }
    return TRUE;
}

static gboolean read_hsh(struct head *head, struct rti *rti, GError **error) {
    double kind, components, terms, skipped;
    float scale[RTI_MAX_TERMS], bias[RTI_MAX_TERMS];
    while (head->at < head->n && head->bytes[head->at] == '#') {
        const guint8 *end = memchr(head->bytes + head->at, '\n', head->n - head->at);
        head->at = end ? (gsize)(end - head->bytes) + 1 : head->n;
    }
    if (!rti_number(head, "type", 3, 3, &kind, error) || !read_size(head, rti, error) ||
        !rti_number(head, "number of colours", 3, 3, &components, error) ||
        !rti_number(head, "number of terms", 4, RTI_MAX_TERMS, &terms, error) ||
        !rti_number(head, "type of basis", 0, 100, &skipped, error) ||
        !rti_number(head, "size of numbers", 0, 100, &skipped, error) || !line_end(head, error))
        return FALSE;
    rti->hsh = TRUE;
    rti->n_terms = (int)terms;
    if (rti->n_terms != 4 && rti->n_terms != 9 && rti->n_terms != 16)
        return data_error_fail(head->path, 0, error,
                               "the file has %d terms; only 4, 9 or 16 can be read. Fit the "
                               "pictures again with one of these numbers",
                               rti->n_terms);
    const gsize bytes = (gsize)rti->n_terms * sizeof(float);
    if (!take(head, scale, bytes, error) || !take(head, bias, bytes, error) ||
        !make_bytes(head, rti, error))
        return FALSE;
    for (int i = 0; i < rti->n_terms; i++) {
        if (!isfinite(scale[i]) || !isfinite(bias[i]) || scale[i] == 0)
            return data_error_fail(head->path, 0, error,
                                   "scale %d is %g and its bias is %g; both must be finite, and "
                                   "the scale must not be 0; copy the file again",
                                   i + 1, (double)scale[i], (double)bias[i]);
        rti->scale[i] = (double)scale[i] / 255;
        rti->bias[i] = -(double)bias[i] / rti->scale[i];
    }
    return take(head, rti->bytes, 3 * (gsize)rti->n_terms * (gsize)rti->width * (gsize)rti->height,
                error);
}

struct rti *rti_read(const char *path, GError **error) {
    GError *found = NULL;
    struct head head = {.path = path};
    g_autofree char *data = input_file_read(path, MAX_BYTES, &head.n, &found);
    if (!data) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
        return NULL;
    }
    head.bytes = (const guint8 *)data;
    g_autoptr(Rti) rti = g_new0(struct rti, 1);
    gboolean ok;
    if (g_str_has_prefix(data, "PTM_1."))
        ok = read_ptm(&head, rti, error);
    else if (g_str_has_prefix(data, "#HSH"))
        ok = read_hsh(&head, rti, error);
    else
        ok = data_error_fail(
            path, 0, error,
            "the file is neither a .ptm file, which begins with PTM_1.2, nor a .rti file of "
            "harmonics, which begins with #HSH1.2; give a file of one of these formats");
    return ok ? g_steal_pointer(&rti) : NULL;
}

void rti_evaluate(const struct rti *rti, gsize texel, const float *basis, float ret[3]) {
    const gsize n = (gsize)rti->n_terms;
    for (gsize c = 0; c < 3; c++) {
        const guint8 *bytes = rti->bytes + (rti->lrgb ? texel : 3 * texel + c) * n;
        double sum = 0;
        for (gsize j = 0; j < n; j++)
            sum += (bytes[j] - rti->bias[j]) * rti->scale[j] * (double)basis[j];
        ret[c] = (float)(rti->lrgb ? sum * rti->colours[3 * texel + c] / 255 : sum);
    }
}

gboolean rti_write_ptm(const char *path, const struct rti *rti, GError **error) {
    const gsize width = (gsize)rti->width, height = (gsize)rti->height, texels = width * height;
    g_autoptr(GString) head = g_string_new(NULL);
    char number[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_printf(head, "PTM_1.2\nPTM_FORMAT_%s\n%d\n%d\n", rti->lrgb ? "LRGB" : "RGB",
                    rti->width, rti->height);
    for (int i = 0; i < RTI_PTM_TERMS; i++)
        g_string_append_printf(head, "%s%c",
                               g_ascii_formatd(number, sizeof number, "%.9g", rti->scale[i] * 255),
                               i < RTI_PTM_TERMS - 1 ? ' ' : '\n');
    for (int i = 0; i < RTI_PTM_TERMS; i++)
        g_string_append_printf(head, "%d%c", (int)lround(rti->bias[i]),
                               i < RTI_PTM_TERMS - 1 ? ' ' : '\n');
    const gsize each = rti->lrgb ? 9 : 18, bytes = head->len + texels * each;
    g_autofree guint8 *out = g_malloc(bytes);
    guint8 *at = out + head->len;
    memcpy(out, head->str, head->len);
    for (gsize c = 0; c < (rti->lrgb ? 1 : 3); c++)
        for (gsize i = 0; i < texels; i++, at += RTI_PTM_TERMS) {
            const gsize texel = (height - 1 - i / width) * width + i % width;
            memcpy(at, rti->bytes + (rti->lrgb ? texel : 3 * texel + c) * RTI_PTM_TERMS,
                   RTI_PTM_TERMS);
        }
    for (gsize i = 0; rti->lrgb && i < texels; i++, at += 3)
        memcpy(at, rti->colours + 3 * ((height - 1 - i / width) * width + i % width), 3);
    return output_file_write(path, out, bytes, error);
}
