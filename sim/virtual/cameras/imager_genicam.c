#include "imager_private.h"

#define NAMESPACE "http://www.genicam.org/GenApi/Version_1_1"

/* The features that all cameras have. In all lists of names in this file, names are separated by
 * spaces. */
static const char features[] =
    "DeviceVendorName DeviceModelName DeviceSerialNumber DeviceID SensorWidth SensorHeight Width "
    "Height OffsetX OffsetY PixelFormat PayloadSize AcquisitionMode AcquisitionStart "
    "AcquisitionStop TriggerSelector TriggerMode TriggerSource TriggerActivation TriggerSoftware "
    "ExposureTime ExposureAuto Gain BlackLevel";

void imager_xml_register(struct imager_xml *xml, const char *name, guint address, int length,
                         const char *access) {
    g_string_append_printf(xml->text,
                           "<IntReg Name=\"%sReg\"><Address>0x%x</Address><Length>%d</Length>"
                           "<AccessMode>%s</AccessMode><pPort>Device</pPort>"
                           "<Sign>Unsigned</Sign><Endianess>%s</Endianess></IntReg>\n",
                           name, address, length, access, xml->endianness);
}

void imager_xml_integer(struct imager_xml *xml, const char *name, guint address, int length,
                        const char *access, const char *limits) {
    g_string_append_printf(xml->text, "<Integer Name=\"%s\"><pValue>%sReg</pValue>%s</Integer>\n",
                           name, name, limits);
    imager_xml_register(xml, name, address, length, access);
}

void imager_xml_string(struct imager_xml *xml, const char *name, guint address, int length) {
    g_string_append_printf(xml->text,
                           "<StringReg Name=\"%s\"><Address>0x%x</Address><Length>%d</Length>"
                           "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>\n",
                           name, address, length);
}

void imager_xml_command(struct imager_xml *xml, const char *name, const char *reg, int value) {
    g_string_append_printf(xml->text,
                           "<Command Name=\"%s\"><pValue>%sReg</pValue>"
                           "<CommandValue>%d</CommandValue></Command>\n",
                           name, reg, value);
}

static void add_register(struct imager_xml *xml, const char *name, guint address,
                         const char *access) {
    imager_xml_register(xml, name, address, 4, access);
}

static void add_integer(struct imager_xml *xml, const char *name, guint address, const char *access,
                        const char *limits) {
    imager_xml_integer(xml, name, address, 4, access, limits);
}

/* Adds a feature whose register counts parts of a unit. The value of the register is the feature's
 * value × parts. */
static void add_float(struct imager_xml *xml, const char *name, guint address, const char *unit,
                      double parts, double max) {
    g_string_append_printf(xml->text,
                           "<Float Name=\"%s\"><pValue>%sConverter</pValue><Min>0</Min>"
                           "<Max>%g</Max><Unit>%s</Unit></Float>\n"
                           "<Converter Name=\"%sConverter\"><FormulaTo>FROM*%g</FormulaTo>"
                           "<FormulaFrom>TO/%g</FormulaFrom><pValue>%sReg</pValue></Converter>\n",
                           name, name, max, unit, name, parts, parts, name);
    add_register(xml, name, address, "RW");
}

/* Adds an enumeration. entries has the names of the values 0, 1 and so on. If address is 0, the
 * enumeration has no register, and its value is always 0. */
static void add_choice(struct imager_xml *xml, const char *name, guint address,
                       const char *entries) {
    g_auto(GStrv) names = g_strsplit(entries, " ", -1);
    g_string_append_printf(xml->text, "<Enumeration Name=\"%s\">\n", name);
    for (int i = 0; names[i]; i++)
        g_string_append_printf(xml->text, "<EnumEntry Name=\"%s\"><Value>%d</Value></EnumEntry>\n",
                               names[i], i);
    if (address == 0) {
        g_string_append(xml->text, "<Value>0</Value></Enumeration>\n");
        return;
    }
    g_string_append_printf(xml->text, "<pValue>%sReg</pValue></Enumeration>\n", name);
    add_register(xml, name, address, "RW");
}

static void add_image(struct imager_xml *xml, enum cfa cfa, gboolean grey_too) {
    add_integer(xml, "SensorWidth", REG_SENSOR_WIDTH, "RO", "");
    add_integer(xml, "SensorHeight", REG_SENSOR_HEIGHT, "RO", "");
    add_integer(xml, "Width", REG_WIDTH, "RW", "<Min>2</Min><pMax>SensorWidth</pMax><Inc>2</Inc>");
    add_integer(xml, "Height", REG_HEIGHT, "RW",
                "<Min>2</Min><pMax>SensorHeight</pMax><Inc>2</Inc>");
    add_integer(xml, "OffsetX", REG_OFFSET_X, "RW",
                "<Min>0</Min><pMax>SensorWidth</pMax><Inc>2</Inc>");
    add_integer(xml, "OffsetY", REG_OFFSET_Y, "RW",
                "<Min>0</Min><pMax>SensorHeight</pMax><Inc>2</Inc>");
    add_integer(xml, "PayloadSize", REG_PAYLOAD, "RO", "");
    g_string_append(xml->text, "<Enumeration Name=\"PixelFormat\">\n");
    imager_append_formats(xml->text, cfa);
    if (grey_too)
        imager_append_formats(xml->text, CFA_MONO);
    g_string_append(xml->text, "<pValue>PixelFormatReg</pValue></Enumeration>\n");
    add_register(xml, "PixelFormat", REG_FORMAT, "RW");
}

static void add_acquisition(struct imager_xml *xml) {

    g_autofree char *exposures =
        g_strdup_printf("<Min>%d</Min><Max>%d</Max>", MIN_EXPOSURE_US, MAX_EXPOSURE_US);
    add_choice(xml, "AcquisitionMode", 0, "Continuous");
    add_choice(xml, "TriggerSelector", 0, "FrameStart");
    add_choice(xml, "TriggerMode", REG_TRIGGER_MODE, "Off On");
    add_choice(xml, "TriggerSource", REG_TRIGGER_FROM, "Line0 Software");
    add_choice(xml, "TriggerActivation", 0, "RisingEdge");
    add_choice(xml, "ExposureAuto", REG_AUTO_EXPOSURE, "Off Continuous");
    imager_xml_command(xml, "AcquisitionStart", "Acquisition", 1);
    imager_xml_command(xml, "AcquisitionStop", "Acquisition", 0);
    add_register(xml, "Acquisition", REG_ACQUISITION, "WO");
    imager_xml_command(xml, "TriggerSoftware", "Trigger", 1);
    add_register(xml, "Trigger", REG_TRIGGER, "WO");
    g_string_append_printf(xml->text,
                           "<Float Name=\"ExposureTime\"><pValue>ExposureTimeReg</pValue>%s"
                           "<Unit>us</Unit></Float>\n",
                           exposures);
    add_register(xml, "ExposureTime", REG_EXPOSURE_US, "RW");
    add_float(xml, "Gain", REG_GAIN, "dB", 100, MAX_GAIN / 100.0);
    add_float(xml, "BlackLevel", REG_BLACK, "DN", 10, 4095);
}

char *imager_genicam(enum cfa cfa, const struct imager_transport *transport,
                     const struct virtual_processing *processing) {
    GString *text = g_string_new("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");
    struct imager_xml xml = {text, transport->endianness};
    g_string_append_printf(
        text,
        "<RegisterDescription ModelName=\"VirtualCamera\" VendorName=\"Mesorig\" "
        "StandardNameSpace=\"%s\" SchemaMajorVersion=\"1\" "
        "SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" "
        "MinorVersion=\"0\" SubMinorVersion=\"0\" ToolTip=\"Virtual camera\" "
        "ProductGuid=\"0\" VersionGuid=\"0\" xmlns=\"" NAMESPACE "\">\n"
        "<Category Name=\"Root\">\n",
        transport->space);
    g_autofree char *all = g_strconcat(features, " ", transport->features, NULL);
    g_auto(GStrv) names = g_strsplit(all, " ", -1);
    for (char **name = names; *name; name++)
        g_string_append_printf(text, "<pFeature>%s</pFeature>\n", *name);
    if (processing)
        g_string_append(text, "<pFeature>ImageProcessing</pFeature>\n");
    g_string_append(text, "</Category>\n");
    if (processing)
        g_string_append(text, processing->xml);
    add_image(&xml, cfa, processing && processing->grey_too);
    add_acquisition(&xml);
    transport->add(&xml);
    g_string_append(text, "<Port Name=\"Device\"></Port>\n</RegisterDescription>\n");
    return g_string_free(text, FALSE);
}
