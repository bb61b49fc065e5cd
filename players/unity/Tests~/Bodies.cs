// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using Hfx.Haptics;
using UnityEngine;

/// <summary>
/// A <see cref="HapticBody"/> among volumes of a clip with two bones, "root" and "wrist.L" (Mixamo "LeftHand"), and the
/// effects "Volume 0" to "Volume 3" and "Painted", the clip of tests/players/small_clip.py. Each demand has a name.
/// </summary>
static class Bodies
{
    /// <summary>Inverse kinematics of another package: it moves a bone in LateUpdate.</summary>
    [DefaultExecutionOrder(9999)]
    sealed class Reach : MonoBehaviour
    {
        public Transform bone;
        public float x;
        void LateUpdate() { bone.localToWorldMatrix = At(x); }
    }

    static int wrong;

    public static int Play(string path)
    {
        wrong = 0;
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(path));
        Order(asset);
        SeveralVolumes(asset);
        Disabling(asset);
        Settings(asset, path);
        Names(asset);
        Garbage(asset);
        return wrong;
    }

    /// <summary>The pose after LateUpdate of other scripts is felt, in whatever order the components were added.</summary>
    static void Order(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "LeftHand");
        Reach reach = new Reach { bone = body.transform.all[1] };
        HapticVolume far = Volume("Volume 1", 100.0f);
        List<MonoBehaviour> components = new List<MonoBehaviour> { body, reach };
        Frames.Play(components, () => body.transform.all[0].localToWorldMatrix = At(0.0f));
        float before = Felt(body, far);
        reach.x = 100.0f;
        Frames.Play(components, () => body.transform.all[0].localToWorldMatrix = At(100.0f));
        Demand(before == 0.0f && Felt(body, far) > 0.0f, "the pose after animation and LateUpdate of others is felt at once");
        Remove(far);
        GameObject.Call(body, "OnDisable");
    }

    static void SeveralVolumes(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L");
        HapticVolume one = Volume("Volume 1", 0.0f), other = Volume("Volume 1", 0.0f), far = Volume("Volume 1", 50.0f);
        Frame(body);
        Demand(Felt(body, one) > 0.0f && Felt(body, other) == Felt(body, one) && Felt(body, far) == 0.0f, "each volume of an effect acts by itself");
        int number = body.NumberOf(other);
        Remove(one);
        Frame(body);
        Demand(body.NumberOf(one) < 0 && body.NumberOf(other) == number && Felt(body, other) > 0.0f, "a disabled volume leaves the others as they are");
        other.Level = 0.5f;
        Frame(body);
        double half = body.Core.GetLevel(number);
        other.Level = 1.0f;
        Frame(body);
        Demand(half > 0.0 && Math.Abs(body.Core.GetLevel(number) - 2.0 * half) < 1e-6, "a level multiplies the effect's own");
        other.Effect = "Volume 2";
        Frame(body);
        Demand(body.Core.GetWeights(number).Length == 0 && body.NumberOf(other) >= 0, "a volume gets another effect");
        Debug.messages.Clear();
        other.Effect = "Volume 7";
        Frame(body);
        Frame(body);
        Demand(Debug.messages.Count == 1 && Debug.messages[0].Contains("'Volume 7'"), "an unknown effect is named once");
        Remove(other);
        Remove(far);
        GameObject.Call(body, "OnDisable");
    }

    static void Disabling(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L");
        body.Trigger("Painted", 1.0f);
        Frame(body);
        float felt = body.Values[0];
        int events = 0;
        body.ValuesChanged += of => events += of.Values[0] == 0.0f ? 1 : 0;
        GameObject.Call(body, "OnDisable");
        Demand(felt > 0.0f && events == 1, "disabling silences");
        GameObject.Call(body, "OnEnable");
        Frame(body);
        Demand(body.Values[0] == felt, "enabled again, it feels, and a painted area stays on");
        GameObject.Call(body, "OnApplicationPause", true);
        GameObject.Call(body, "OnApplicationFocus", false);
        GameObject.Call(body, "OnApplicationFocus", true);
        Frame(body);
        Demand(body.Values[0] == 0.0f, "a pause outlasts a focus that is lost and found");
        GameObject.Call(body, "OnApplicationPause", false);
        Frame(body);
        Demand(body.Values[0] == felt, "it goes on");
        // An avatar that moves far while nothing is felt has no speed afterwards: Volume 1 has a speed filter.
        HapticVolume volume = Volume("Volume 1", 0.0f);
        Frame(body);
        double still = body.Core.GetLevel(body.NumberOf(volume));
        Time.timeScale = 0.0f;
        Frame(body);
        volume.transform.localToWorldMatrix = At(0.05f);
        Time.timeScale = 1.0f;
        Frame(body);
        Demand(Math.Abs(body.Core.GetLevel(body.NumberOf(volume)) - still) < 1e-9, "what moved while time stood still is no touch");
        Remove(volume);
        GameObject.Call(body, "OnDisable");
    }

    static void Settings(HapticClipAsset asset, string path)
    {
        GameObject avatar = new GameObject();
        Debug.messages.Clear();
        HapticBody body = avatar.AddComponent<HapticBody>();
        Frame(body);
        Frame(body);
        Demand(body.Core == null && Debug.messages.Count == 1 && Debug.messages[0].Contains("choose a clip"), "a missing clip is said once");
        avatar.transform.all.Add(new Transform { name = "root" });
        body.Trigger("Painted", 1.0f);
        body.Asset = asset;
        Frame(body);
        Demand(body.Values != null && body.Values[0] > 0.0f, "a clip and a trigger that come after AddComponent");
        Demand(Debug.messages.Count == 2 && Debug.messages[1].Contains("wrist.L") && body.MissingBones.Length == 1, "a missing bone is named");
        avatar.transform.all.Add(new Transform { name = "hand_l" });
        GameObject.Call(body, "OnTransformChildrenChanged");
        Frame(body);
        Demand(body.MissingBones.Length == 0 && Debug.messages.Count == 2, "a bone that comes later is found");
        HapticClipAsset again = ScriptableObject.CreateInstance<HapticClipAsset>();
        again.SetBytes(File.ReadAllBytes(path));
        LiveBody core = body.Core;
        body.Asset = again;
        Frame(body);
        Demand(body.Core != core && body.Core.Clip == again.Clip && body.Values[0] > 0.0f, "another clip is played");
        body.BodyName = "Nobody";
        Frame(body);
        Demand(body.Core == null && Debug.messages[2].Contains("'Nobody', but: Body"), "an unknown body is named");
        body.BodyName = "Body";
        Frame(body);
        Demand(body.Core != null, "a name that is right again");
        GameObject.Call(body, "OnDisable");
    }

    /// <summary>Names of one avatar for hips, spine, left upper arm, left hand, right lower leg, left index and right thumb.</summary>
    static void Names(HapticClipAsset asset)
    {
        Bone[] bones =
        {
            Named("root", "hips", "Hips", "pelvis"), Named("spine05", "spine", "Spine", "spine_01"),
            Named("spine03", "chest", "Spine1", "spine_02"), Named("upperarm01.L", "leftUpperArm", "LeftArm", "upperarm_l"),
            Named("wrist.L", "leftHand", "LeftHand", "hand_l"), Named("lowerleg01.R", "rightLowerLeg", "RightLeg", "calf_r"),
            Named("finger2-1.L", "leftIndexProximal", "LeftHandIndex1", "index_01_l"),
            Named("finger1-1.R", "rightThumbMetacarpal", "RightHandThumb1", "thumb_01_r"),
        };
        string[][] avatars =
        {
            "root spine05 spine03 upperarm01.L wrist.L lowerleg01.R finger2-1.L finger1-1.R".Split(' '),
            "root spine05 spine03 upperarm01_L wrist_L lowerleg01_R finger2-1_L finger1-1_R".Split(' '),
            "Hips Spine Chest LeftUpperArm LeftHand RightLowerLeg LeftIndexProximal RightThumbMetacarpal".Split(' '),
            "mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:LeftArm mixamorig:LeftHand mixamorig:RightLeg mixamorig:LeftHandIndex1 mixamorig:RightHandThumb1".Split(' '),
            "mixamorig7_Hips mixamorig7_Spine mixamorig7_Spine1 mixamorig7_LeftArm mixamorig7_LeftHand mixamorig7_RightLeg mixamorig7_LeftHandIndex1 mixamorig7_RightHandThumb1".Split(' '),
            "Hero_Hips Hero_Spine Hero_Spine1 Hero_LeftArm Hero_LeftHand Hero_RightLeg Hero_LeftHandIndex1 Hero_RightHandThumb1".Split(' '),
            "pelvis spine_01 spine_02 upperarm_l hand_l calf_r index_01_l thumb_01_r".Split(' '),
            "DEF-spine DEF-spine.001 DEF-spine.002 DEF-upper_arm.L DEF-hand.L DEF-shin.R DEF-f_index.01.L DEF-thumb.01.R".Split(' '),
            "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_L_UpperArm J_Bip_L_Hand J_Bip_R_LowerLeg J_Bip_L_Index1 J_Bip_R_Thumb1".Split(' '),
            "Bip01 Pelvis|Bip01 Spine|Bip01 Spine1|Bip01 L UpperArm|Bip01 L Hand|Bip01 R Calf".Split('|'),
            "hips spine chest upper_arm.left hand.left lower_leg.right index_proximal.left thumb_metacarpal.right".Split(' '),
        };
        foreach (string[] names in avatars)
        {
            List<Transform> all = names.Select(name => new Transform { name = name }).ToList();
            // Of other parts: the floor, a twist bone, a control, an object in the hand.
            string[] others = { names[0] == "root" ? "Armature" : "root", "upperarm_twist_01_l", "LeftHandGrip", "ORG-hand.L" };
            all.InsertRange(0, others.Select(name => new Transform { name = name }));
            Transform[] found = BoneNames.Find(bones, all.ToArray(), null);
            string seen = string.Join(" ", found.Take(names.Length).Select(of => of == null ? "-" : of.name));
            Demand(seen == string.Join(" ", names), "names of bones: " + seen);
        }
        Demand(asset.Clip.Bodies[0].Bones.All(bone => bone.HasSkin), "both bones carry skin");
    }

    static void Garbage(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L");
        List<HapticVolume> volumes = new List<HapticVolume>();
        for (int k = 0; k < 8; k++) volumes.Add(Volume("Volume " + k % 4, 0.1f * k));
        Action frame = (Action)Delegate.CreateDelegate(typeof(Action), body, "LateUpdate");
        body.Trigger("Painted", 1.0f);
        frame();
        long before = GC.GetTotalMemory(true);
        for (int k = 0; k < 2000; k++)
        {
            body.Trigger("Painted", 0.5f);
            frame();
            if (k % 2 == 0) HapticVolume.All.Remove(volumes[0]); // shot and gone
            else HapticVolume.All.Add(volumes[0]);
        }
        long grown = GC.GetTotalMemory(false) - before;
        Demand(grown < 1000, "no garbage in 2,000 frames: " + grown + " bytes");
        foreach (HapticVolume volume in volumes) Remove(volume);
        GameObject.Call(body, "OnDisable");
    }

    static Bone Named(string name, string human, string mixamo, string unreal)
    {
        return new Bone { Name = name, Human = human, Mixamo = mixamo, Unreal = unreal };
    }

    static HapticBody Body(HapticClipAsset asset, params string[] bones)
    {
        GameObject avatar = new GameObject();
        foreach (string bone in bones) avatar.transform.all.Add(new Transform { name = bone });
        HapticBody body = avatar.AddComponent<HapticBody>();
        body.Asset = asset;
        return body;
    }

    static HapticVolume Volume(string effect, float x)
    {
        HapticVolume volume = new GameObject().AddComponent<HapticVolume>();
        volume.Effect = effect;
        volume.transform.localToWorldMatrix = At(x);
        return volume;
    }

    static void Remove(HapticVolume volume) { GameObject.Call(volume, "OnDisable"); }

    static Matrix4x4 At(float x)
    {
        Matrix4x4 found = Matrix4x4.identity;
        found.m03 = x;
        return found;
    }

    static float Felt(HapticBody body, HapticVolume volume)
    {
        return body.Core.GetWeights(body.NumberOf(volume)).DefaultIfEmpty().Max();
    }

    static void Frame(HapticBody body) { GameObject.Call(body, "LateUpdate"); }

    static void Demand(bool holds, string what)
    {
        if (holds) return;
        wrong++;
        Console.WriteLine("not held: " + what);
    }
}
