#include "codecs.h"

#include "eigenmaps/eigenmaps_codec.h"
#include "hsh/hsh_codec.h"
#include "lobes/lobes_codec.h"
#include "lpca/lpca_codec.h"
#include "neural/neural_codec.h"
#include "session/session.h"

#include <gio/gio.h>
#include <string.h>

const struct codec *const codecs[] = {
    &lpca_codec,
    &eigenmaps_codec,
    &lobes_codecs[LOBES_FIELDS],
    &lobes_codecs[LOBES_PTM],
    &hsh_codec,
    &lobes_codecs[LOBES_LAFORTUNE],
    &lobes_codecs[LOBES_WARD],
    &lobes_codecs[LOBES_ASHIKHMIN],
    &neural_codec,
    NULL,
};

const struct codec *codecs_find(const char *name) {
    for (gsize i = 0; codecs[i]; i++)
        if (g_strcmp0(codecs[i]->name, name) == 0)
            return codecs[i];
    return NULL;
}

const struct codec *codecs_of_file(const char *path, GError **error) {
    if (!session_check_product(path, error))
        return NULL;
    struct exr_file *file = exr_read_headers(path, error);
    if (!file)
        return NULL;
    const char *kind = NULL;
    for (guint i = 0; !kind && i < file->parts->len; i++)
        exr_get_string(file->parts->pdata[i], "mesorig.kind", &kind, NULL);
    const struct codec *codec = codecs_find(kind);
    if (!kind)
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                    "%s: the attribute mesorig.kind is missing; give a session or a file that "
                    "“mesorig compress” wrote",
                    path);
    else if (!codec)
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                    "%s: the file is of kind “%s”, which is not a compressed BTF; give a session "
                    "or a compressed BTF",
                    path, kind);
    exr_file_free(file);
    return codec;
}

Material *material_open(const char *path, const struct work *work, GError **error) {
    g_autofree char *label = g_path_get_basename(path);
    const struct codec *codec = &material_btf_codec;
    gpointer model = NULL;
    if (g_file_test(path, G_FILE_TEST_IS_DIR))
        model = btf_matrix_read(path, work, error);
    else if ((codec = codecs_of_file(path, error)))
        model = codec->read(path, error);
    return model ? material_new(label, codec, model) : NULL;
}
