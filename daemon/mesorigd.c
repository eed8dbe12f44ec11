/* mesorigd: holds the devices of a rig, runs sessions, and is told what to do over D-Bus. */
#include <glib.h>

int main(int argc, char **argv) {
    g_print("mesorigd %s\n", MESORIG_VERSION);
    return argc > 0 && argv ? 0 : 2;
}
