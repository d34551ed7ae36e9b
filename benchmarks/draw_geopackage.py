"""Draws a survey's GeoPackage by QGIS: `/usr/bin/python3 benchmarks/draw_geopackage.py survey.gpkg MAP.png`.

Needs the system's QGIS with its Python (Debian: `apt-get install python3-qgis`), no screen and nothing of
plnerf.  Every layer is opened as a user's project opens it: with the style that the file holds for it.
Prints for each its features, symbol's colour and labels, and which labels had room; ends with status 1
where a layer cannot be opened or has not its style.
"""

import argparse
import os
import sqlite3
import sys
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import (
    QgsApplication,
    QgsExpression,
    QgsExpressionContext,
    QgsMapRendererSequentialJob,
    QgsMapSettings,
    QgsRectangle,
    QgsSymbol,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor

MARGIN = 0.08
"""Around what is drawn, as a part of it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("geopackage", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--width", type=int, default=1400, help="pixels (default: 1400)")
    parser.add_argument("--height", type=int, default=900, help="pixels (default: 900)")
    options = parser.parse_args()
    QgsApplication.setPrefixPath("/usr", True)
    application = QgsApplication([], False)
    application.initQgis()
    layers = opened(options.geopackage)
    draw(layers, options.picture, QSize(options.width, options.height))
    print(f"{options.picture}: drawn by QGIS")
    del layers
    application.exitQgis()


def opened(path: Path) -> list[QgsVectorLayer]:
    """All layers of a file, with the styles that lie in it; areas first, points last."""
    base = sqlite3.connect(path)
    names = [name for (name,) in base.execute("select table_name from gpkg_geometry_columns")]
    styled = {name for (name,) in base.execute("select f_table_name from layer_styles where useAsDefault")}
    base.close()
    layers = []
    for name in names:
        layer = QgsVectorLayer(f"{path}|layername={name}", name, "ogr")
        if not layer.isValid() or not layer.crs().isValid():
            sys.exit(f"QGIS cannot open the layer {name} of {path}, or not its reference system.")
        _, loaded = layer.loadDefaultStyle()
        if not loaded or name not in styled:
            sys.exit(f"QGIS finds no style of the layer {name} in {path}.")
        symbol, labels = layer.renderer().symbol(), layer.labeling()
        colour = symbol.symbolLayer(0).strokeColor() if symbol.type() == QgsSymbol.Fill else symbol.color()
        texts = labelled(layer, labels.settings().fieldName) if labels and layer.labelsEnabled() else "-"
        crs = layer.crs().authid()
        print(f"{name}: {layer.featureCount()} features, {colour.name()}, labels {texts}, {crs}")
        layers.append(layer)
    return sorted(layers, key=lambda layer: layer.geometryType(), reverse=True)


def labelled(layer: QgsVectorLayer, expression: str) -> str:
    """The labels of all features."""
    context, texts = QgsExpressionContext(), QgsExpression(expression)
    found = []
    for feature in layer.getFeatures():
        context.setFeature(feature)
        context.setFields(layer.fields())
        found.append(str(texts.evaluate(context)))
    return " ".join(found)


def draw(layers: list[QgsVectorLayer], picture: Path, size: QSize) -> None:
    """A map of all layers on white."""
    settings, extent = QgsMapSettings(), QgsRectangle()
    settings.setLayers(layers[::-1])  # the first one given lies on top
    settings.setDestinationCrs(layers[0].crs())
    for layer in layers:
        extent.combineExtentWith(layer.extent())
    extent.grow(MARGIN * max(extent.width(), extent.height()))
    settings.setExtent(extent)
    settings.setOutputSize(size)
    settings.setBackgroundColor(QColor("white"))
    job = QgsMapRendererSequentialJob(settings)
    job.start()
    job.waitForFinished()
    if job.errors() or not job.renderedImage().save(str(picture)):
        sys.exit(f"QGIS did not draw {picture}: {[error.message for error in job.errors()]}")
    names, drawn = {layer.id(): layer.name() for layer in layers}, {layer.name(): [] for layer in layers}
    for label in job.takeLabelingResults().allLabels():
        drawn[names[label.layerID]].append(label.labelText)
    print("labels drawn:", *(f"{name} {' '.join(sorted(texts))}," for name, texts in drawn.items() if texts))


if __name__ == "__main__":
    main()
