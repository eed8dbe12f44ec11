/* make_mime TEMPLATE prints the template of the MIME types, with a glob for the file of each codec
 * instead of the line @CODECS@. */
#include "codecs/codecs.h"

#include <stdio.h>
#include <string.h>

int main(int argc, char **argv) {
    static const char mark[] = "\n@CODECS@\n";
    g_autoptr(GError) error = NULL;
    g_autofree char *text = NULL;
    const gboolean read = argc == 2 && g_file_get_contents(argv[1], &text, NULL, &error);
    char *at = read ? strstr(text, mark) : NULL;
    if (!at) {
        g_printerr("make_mime: %s\n", error  ? error->message
                                      : read ? "the template has no line @CODECS@"
                                             : "usage: make_mime TEMPLATE");
        return 1;
    }
    *at = '\0';
    puts(text);
    for (gsize i = 0; codecs[i]; i++)
        printf("    <glob pattern=\"%s.exr\" weight=\"60\"/>\n", codecs[i]->name);
    fputs(at + strlen(mark), stdout);
    return 0;
}
