"""FMUs as FMPy runs them, with variables by name."""


class Instance:
    """An FMU by FMPy, with variables by name."""

    def __init__(self, fmpy, path, folder):
        description = fmpy.read_model_description(str(path))
        self.references = {x.name: x.valueReference for x in description.modelVariables}
        kinds = {"2.0": fmpy.fmi2.FMU2Slave, "3.0": fmpy.fmi3.FMU3Slave}
        self.is_2 = description.fmiVersion == "2.0"
        self.fmu = kinds[description.fmiVersion](
            guid=description.guid if self.is_2 else description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.fmu.instantiate()
        self.begin()

    def begin(self):
        if self.is_2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.t = 0.0

    def get(self, *names):
        read = self.fmu.getReal if self.is_2 else self.fmu.getFloat64
        return list(read([self.references[name] for name in names]))

    def set(self, name, value):
        write = self.fmu.setReal if self.is_2 else self.fmu.setFloat64
        write([self.references[name]], [value])

    def step(self, h):
        self.fmu.doStep(currentCommunicationPoint=self.t, communicationStepSize=h)
        self.t += h

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
