"""Parameters of friction models from measurements: Maxwell-slip elements (app. D), Stribeck curves (sec. 5.6), any model."""
